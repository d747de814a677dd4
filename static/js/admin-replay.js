// A trial's replay: both films run side by side, the one that was on screen then is marked, as is the time.

const replay = document.getElementById("replay");
const line = document.getElementById("replay-time");
const now = document.getElementById("replay-now");
const button = document.getElementById("replay-play");
const films = [...replay.querySelectorAll("video")];
const shownMs = Number(replay.dataset.shownMs);
const filmS = Number(replay.dataset.filmS);

if (line) {
  const looks = [...line.querySelectorAll(".look")].map((look) => ({
    label: look.classList.contains("look-a") ? "a" : "b",
    from: look.x.baseVal.value / 1000,
    to: (look.x.baseVal.value + look.width.baseVal.value) / 1000,
  }));
  let at = 0; // part of the exposure
  let startedAt = null; // performance.now() at which `at` was 0, while it runs

  const show = () => {
    now.setAttribute("x1", String(1000 * at));
    now.setAttribute("x2", String(1000 * at));
    const look = looks.find((one) => at >= one.from && at < one.to) ?? looks.at(-1);
    for (const figure of replay.querySelectorAll("figure"))
      figure.classList.toggle("is-on-screen", figure.dataset.label === look.label);
  };
  const stop = () => {
    startedAt = null;
    for (const film of films) film.pause();
    button.textContent = at >= 1 ? "Play again" : "Play";
  };
  const step = (time) => {
    if (startedAt === null) return;
    at = Math.min(1, (time - startedAt) / shownMs);
    show();
    if (at >= 1) stop();
    else requestAnimationFrame(step);
  };
  const seek = (part) => {
    at = part;
    for (const film of films) film.currentTime = ((at * shownMs) / 1000) % filmS;
    show();
  };

  button.addEventListener("click", async () => {
    if (startedAt !== null) return stop();
    if (at >= 1) seek(0);
    await Promise.all(films.map((film) => film.play()));
    startedAt = performance.now() - at * shownMs;
    button.textContent = "Pause";
    requestAnimationFrame(step);
  });
  line.addEventListener("click", (event) => {
    stop();
    const box = line.getBoundingClientRect();
    seek(Math.min(1, Math.max(0, (event.clientX - box.left) / box.width)));
  });
  for (const film of films) film.loop = true;
  show();
}
