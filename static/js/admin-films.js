// Stimuli: a video is fetched when its Play button is pressed, and shown in place of its still picture.

import { required } from "./elements.js";

for (const button of document.querySelectorAll("[data-play]")) {
  const video = required(HTMLVideoElement, "video", button.parentElement ?? document);
  button.addEventListener("click", async () => {
    if (!video.src) video.src = video.dataset.src ?? "";
    if (video.paused) await video.play();
    else video.pause();
    button.textContent = video.paused ? "Play" : "Pause";
  });
}
