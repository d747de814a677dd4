// Films on pages of stimuli. Those of a study are fetched when their Play button is pressed, and shown in place of a still
// picture. Those of a stimulus set, with the browser's own controls, show their first picture once they are in view.

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

const inView = new IntersectionObserver((entries) => {
  for (const { isIntersecting, target } of entries) {
    if (!isIntersecting) continue;
    /** @type {HTMLVideoElement} */ (target).preload = "metadata";
    inView.unobserve(target);
  }
});
for (const video of document.querySelectorAll("video[data-lazy]")) inView.observe(video);
