import assert from "node:assert/strict";
import { test } from "node:test";

import { bestTechnique, filmsOf, newPlayer } from "../../../static/js/technique.js";

const PAIR = 'video/mp4; codecs="avc1.640032"';
const SINGLE = 'video/mp4; codecs="avc1.640028"';
const SECOND = 'video/webm; codecs="vp09.00.50.08"';
const MEDIA = { url: "/pair.mp4", second: { url: "/pair.webm", type: SECOND }, singles: ["/top.mp4", "/bottom.mp4"] };

/** Makes this process a browser that plays some types of video, and perhaps decodes pictures itself. */
function beBrowser({ plays = [], decodes = null }) {
  const video = () => ({ canPlayType: (type) => (plays.includes(type) ? "probably" : "") });
  globalThis.document = { createElement: video };
  globalThis.VideoDecoder = class {
    static isConfigSupported = async ({ codec }) => ({ supported: decodes && SINGLE.includes(codec) });
  };
  globalThis.window = decodes === null ? {} : { VideoDecoder };
}

const subsets = (values) => values.reduce((sets, value) => sets.flatMap((set) => [set, [...set, value]]), [[]]);
const OFFERS = [undefined, SECOND].flatMap((second) => [undefined, "webcodecs"].map((fallback) => ({ second, fallback })));

test("the best technique that browser and study share is chosen", async () => {
  for (const plays of subsets([PAIR, SECOND, SINGLE])) {
    for (const decodes of [null, false, true]) { // null: the browser has no decoder at all
      for (const offer of OFFERS) {
        beBrowser({ plays, decodes });
        const possible = {
          stacked: plays.includes(PAIR) || plays.includes(offer.second),
          webcodecs: decodes === true && offer.fallback !== undefined,
        };
        const best = ["stacked", "webcodecs"].find((technique) => possible[technique]) ?? null;
        assert.equal(await bestTechnique(offer), best, JSON.stringify({ plays, decodes, offer }));
      }
    }
  }
});

test("the pair's film is fetched in H.264 where that plays, else in its second type", () => {
  beBrowser({ plays: [PAIR, SECOND] });
  assert.deepEqual(filmsOf("stacked", MEDIA), ["/pair.mp4"]);
  beBrowser({ plays: [SECOND] });
  assert.deepEqual(filmsOf("stacked", MEDIA), ["/pair.webm"]);
  assert.deepEqual(filmsOf("stacked", { ...MEDIA, second: null }), ["/pair.mp4"]);
});

test("the film for slow lines is fetched where it is wanted, exists and plays", () => {
  const media = { ...MEDIA, lighter: "/pair.lighter" };
  beBrowser({ plays: [PAIR, SECOND] });
  assert.deepEqual(filmsOf("stacked", media, true), ["/pair.lighter"]);
  assert.deepEqual(filmsOf("stacked", media), ["/pair.mp4"]);
  assert.deepEqual(filmsOf("stacked", { ...media, lighter: null }, true), ["/pair.mp4"]);
  assert.deepEqual(filmsOf("webcodecs", media, true), media.singles);
  beBrowser({ plays: [SECOND] });
  assert.deepEqual(filmsOf("stacked", media, true), ["/pair.webm"]);
});

test("the fallback fetches a film of each stimulus, and says when there is none", () => {
  assert.deepEqual(filmsOf("webcodecs", MEDIA), MEDIA.singles);
  assert.throws(() => filmsOf("webcodecs", { ...MEDIA, singles: null }), /no film of each stimulus/);
});

test("every technique has a player that shows one of the strips", () => {
  globalThis.HTMLVideoElement = class {};
  globalThis.document = { createElement: () => ({}) };
  const film = { querySelector: () => new HTMLVideoElement() };
  const players = ["stacked", "webcodecs"].map((technique) => newPlayer(technique, film));
  assert.equal(new Set(players.map((player) => player.constructor)).size, 2);
  for (const player of players) assert.equal(player.shown, "a");
});
