// Films on pages of stimuli. Those of a study are fetched when their Play button is pressed, and shown in place of a still
// picture. Those of a stimulus set, with the browser's own controls, show their first picture once they are in view.

import { required } from "./elements.js";

for (const button of document.querySelectorAll("[data-play]")) {
  const video = required(HTMLVideoElement, "video", button.parentElement ?? document);
  const fault = document.createElement("p");
  fault.className = "bad";
  fault.setAttribute("role", "alert");
  button.addEventListener("click", async () => {
    if (!video.src) video.src = video.dataset.src ?? "";
    fault.remove();
    if (!video.paused) video.pause();
    else await video.play().catch(({ name }) => name !== "AbortError" && tell()); // aborted: paused again before it began
  });
  const tell = () => {
    fault.textContent = "This browser could not play the film.";
    button.closest("figure")?.append(fault);
    video.pause();
    video.removeAttribute("src"); // the next press asks for it again
    name();
  };
  const name = () => {
    button.textContent = video.paused ? "Play" : "Pause";
    button.setAttribute("aria-label", `${button.textContent} ${video.getAttribute("aria-label")}`);
  };
  for (const change of ["play", "pause"]) video.addEventListener(change, name);
}

const inView = new IntersectionObserver((entries) => {
  for (const { isIntersecting, target } of entries) {
    if (!isIntersecting) continue;
    /** @type {HTMLVideoElement} */ (target).preload = "metadata";
    inView.unobserve(target);
  }
});
for (const video of document.querySelectorAll("video[data-lazy]")) inView.observe(video);

// A film that this browser does not play, such as HEVC, is shown by a preview that the server makes.
for (const video of document.querySelectorAll("video[data-preview]")) {
  const preview = /** @type {HTMLVideoElement} */ (video).dataset.preview ?? "";
  const show = () => video.getAttribute("src") !== preview && video.setAttribute("src", preview);
  video.addEventListener("error", show, { once: true });
  if (/** @type {HTMLVideoElement} */ (video).error) show();
}
