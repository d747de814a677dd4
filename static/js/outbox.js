/** Keeps votes and reports of interrupted trials in this browser until the server has stored them. */

import { Refusal, patiently } from "./connection.js";
import { TooLong, within } from "./patience.js";
import { sendVoid, sendVote } from "./session.js";

/**
 * @typedef {import("./session.js").Vote} Vote
 * @typedef {{reason: import("./session.js").Reason, viewing: import("./session.js").Viewing}} Interruption
 * @typedef {{id: string, owner: string, trial: string, vote?: Vote, interruption?: Interruption}} Pending a vote or an interruption
 */

const DATABASE = "reconstudy";
const STORE = "votes";
const SETTLED_ELSEWHERE = 409; // another tab has voted on this trial
const NEVER_TAKEN = 422; // the server finds it invalid, and always will; it shows the trial again

export class Outbox {
  /** @param {Shelf} shelf @param {string} owner id of the session whose votes to send: a browser may serve several participants in a row */
  constructor(shelf, owner) {
    this.shelf = shelf;
    this.owner = owner;
    this.delivery = Promise.resolve();
  }

  /** Resolves when the vote is kept, which is before it is sent. @param {string} trial @param {Vote} vote */
  async putVote(trial, vote) {
    await this.#put({ id: vote.id, owner: this.owner, trial, vote });
  }

  /** @param {string} trial @param {Interruption} interruption */
  async putInterruption(trial, interruption) {
    await this.#put({ id: newId(), owner: this.owner, trial, interruption });
  }

  /** @param {Pending} pending */
  async #put(pending) {
    await this.shelf.add(pending);
    this.emptied().catch(() => {}); // who waits for emptied() handles the error
  }

  /** Drops what was not sent: the participant has withdrawn. */
  async clear() {
    for (const { id } of await this.shelf.list(this.owner)) await this.shelf.remove(id);
  }

  /** Resolves when the server has everything that it can take; rejects when it refuses something that it may take later. @returns {Promise<void>} */
  emptied() {
    const turn = this.delivery.catch(() => {}).then(() => this.#deliver());
    this.delivery = turn;
    return turn;
  }

  async #deliver() {
    for (const { id, trial, vote, interruption } of await this.shelf.list(this.owner)) {
      if (vote) await patiently(() => sendVote(trial, vote)).catch(letGo);
      if (interruption) await patiently(() => sendVoid(trial, interruption)).catch(letGo);
      await this.shelf.remove(id);
    }
  }
}

/** Accepts that the server will never take something, or has another tab's vote; throws any other error. @param {unknown} error */
function letGo(error) {
  if (error instanceof Refusal && error.status === NEVER_TAKEN) console.error("this can never be taken and is dropped:", error);
  else if (!(error instanceof Refusal) || error.status !== SETTLED_ELSEWHERE) throw error;
}

/**
 * @typedef {object} Shelf
 * @property {(pending: Pending) => Promise<unknown>} add
 * @property {(owner: string) => Promise<Pending[]>} list
 * @property {(id: string) => Promise<unknown>} remove
 */

/**
 * Opens the shelf on disk and in memory, where what this page adds stays, too: a browser may refuse its storage, lose it at
 * any time, or never answer. It is waited for once, for `PATIENCE_MS`.
 * @param {() => void} [onLost] told when something is in memory alone
 * @returns {Shelf}
 */
export function openShelf(onLost = () => {}) {
  const memory = shelfInMemory();
  /** @type {Promise<Shelf> | null} */
  let disk = within(openDatabase()).then(shelfOnDisk);
  const lose = (/** @type {unknown} */ error) => {
    if (error instanceof TooLong) disk = null;
    onLost();
  };
  disk.catch((error) => {
    disk = null;
    lose(error);
  });
  /** @template T @param {(shelf: Shelf) => Promise<T>} action @returns {Promise<T | void>} */
  const onDisk = async (action) => {
    if (disk) return within(disk.then(action)).catch(lose);
  };
  return {
    add: (pending) => Promise.all([memory.add(pending), onDisk((shelf) => shelf.add(pending))]),
    list: async (owner) => {
      const both = [...((await onDisk((shelf) => shelf.list(owner))) ?? []), ...(await memory.list(owner))];
      return [...new Map(both.map((pending) => [pending.id, pending])).values()];
    },
    remove: (id) => Promise.all([memory.remove(id), onDisk((shelf) => shelf.remove(id))]),
  };
}

/** @param {IDBDatabase} database @returns {Shelf} */
function shelfOnDisk(database) {
  /** @param {(votes: IDBObjectStore) => void} change */
  const write = (change) =>
    new Promise((resolve, reject) => {
      const transaction = database.transaction(STORE, "readwrite", { durability: "strict" });
      transaction.oncomplete = resolve;
      transaction.onabort = () => reject(transaction.error);
      change(transaction.objectStore(STORE));
    });
  return {
    add: (pending) => write((votes) => votes.put(pending)),
    remove: (id) => write((votes) => votes.delete(id)),
    list: async (owner) => {
      const all = await answer(database.transaction(STORE).objectStore(STORE).getAll());
      return all.filter((pending) => pending.owner === owner);
    },
  };
}

/** @returns {Shelf} */
function shelfInMemory() {
  /** @type {Map<string, Pending>} */
  const votes = new Map();
  return {
    add: async (pending) => votes.set(pending.id, pending),
    remove: async (id) => votes.delete(id),
    list: async (owner) => [...votes.values()].filter((pending) => pending.owner === owner),
  };
}

/** @returns {Promise<IDBDatabase>} */
async function openDatabase() {
  const opening = indexedDB.open(DATABASE, 1);
  opening.onupgradeneeded = () => opening.result.createObjectStore(STORE, { keyPath: "id" });
  return answer(opening);
}

/** @template T @param {IDBRequest<T>} question @returns {Promise<T>} */
function answer(question) {
  return new Promise((resolve, reject) => {
    question.onsuccess = () => resolve(question.result);
    question.onerror = () => reject(question.error);
  });
}

/**
 * Makes a UUID of version 7 (RFC 9562): the time, then 74 random bits. Sorted by it, votes leave in the order in which
 * they were given, and the server's index has neighbouring times side by side. @returns {string}
 */
export function newId() {
  const time = Date.now().toString(16).padStart(12, "0");
  const bytes = crypto.getRandomValues(new Uint8Array(10));
  bytes[0] = (bytes[0] & 0x0f) | 0x70; // the version
  bytes[2] = (bytes[2] & 0x3f) | 0x80; // the variant
  const hex = time + Array.from(bytes, (byte) => byte.toString(16).padStart(2, "0")).join("");
  return hex.replace(/^(.{8})(.{4})(.{4})(.{4})(.{12})$/, "$1-$2-$3-$4-$5");
}
