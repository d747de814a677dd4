/** Practice: each pair comes again until the participant has switched; any choice will do. */

import { patiently } from "./connection.js";
import { readPractice } from "./session.js";
import { show } from "./views.js";

/** @param {import("./own-session.js").OwnSession} own @param {import("./trials.js").Trials} trials @returns {Promise<string>} the view to show next */
export async function practise(own, trials) {
  const pairs = await patiently(readPractice);
  while (own.practised.length < pairs.length) {
    const description = pairs[own.practised.length];
    show("trial");
    const { vote } = await trials.show(description, performance.now());
    if (!vote) throw new Error("practice is not interrupted");
    if (vote.viewing.switches.length === 0 && description.media.layout !== "single") return "practice-again";
    const { id: _, viewing, ...answer } = vote;
    const { shown_ms, response_ms, switches } = viewing;
    own.practised.push({ trial: description.trial, ...answer, shown_ms, response_ms, n_switches: switches.length });
  }
  return "practice-done";
}
