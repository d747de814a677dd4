// Stimuli: a film is fetched when its Play is pressed, and shown in place of its still.

for (const button of document.querySelectorAll("[data-play]")) {
  const video = /** @type {HTMLVideoElement} */ (button.parentElement.querySelector("video"));
  button.addEventListener("click", async () => {
    if (!video.src) video.src = video.dataset.src;
    if (video.paused) await video.play();
    else video.pause();
    button.textContent = video.paused ? "Play" : "Pause";
  });
}
