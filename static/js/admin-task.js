// Loads the page of a task again, every second while the server answers: it stands still while a server starts anew.

const AGAIN_MS = 1000;

async function loadAgain() {
  const answer = await fetch(location.href).catch(() => null);
  if (answer && answer.status < 500) location.reload();
  else setTimeout(loadAgain, AGAIN_MS);
}

setTimeout(loadAgain, AGAIN_MS);
