/** Waits for the browser, which may never answer: a known fault of storage in WebKit, and of any device that is full or broken. */

export const PATIENCE_MS = 2000;

export class TooLong extends Error {}

/** @template T @param {Promise<T>} answer @param {number} [milliseconds] @returns {Promise<T>} rejects when it takes longer */
export function within(answer, milliseconds = PATIENCE_MS) {
  return new Promise((resolve, reject) => {
    const timer = setTimeout(() => reject(new TooLong(`the browser does not answer within ${milliseconds} ms`)), milliseconds);
    answer.then(resolve, reject).finally(() => clearTimeout(timer));
  });
}
