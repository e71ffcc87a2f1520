// SPDX-License-Identifier: Apache-2.0
import assert from 'node:assert/strict';
import test from 'node:test';
import { ApiError, follow, kOpen_ms, whileOpen } from '../src/api.js';
import { measuredAttempt } from '../src/pages/block.js';
import { bandVerdict } from '../src/verdict.js';

const settled = async () => {
  for (let i = 0; i < 20; ++i) await Promise.resolve();
};
const open = { ended: null, verdict: 'none' };
const ended = { ended: '2026-11-29T06:05:53Z', verdict: 'fail' };

/// follow() with answers that are given by hand and timers that run by hand.
function followed(every_ms) {
  const asked = [];
  const shown = [];
  let timers = [];
  const world = {
    setTimeout: (call, ms) => timers.push({ call, ms }),
    clearTimeout: (id) => (timers = timers.filter((_, i) => i !== id - 1)),
  };
  const ask = (signal) => new Promise((answer, refuse) => asked.push({ signal, answer, refuse }));
  const { again, end } = follow(ask, every_ms, (answer) => shown.push(answer), world);
  /// Runs the timer: its milliseconds, or null if there is none.
  const wait = () => {
    const [timer] = timers.splice(0);
    timer?.call();
    return timer?.ms ?? null;
  };
  return { asked, shown, wait, again, end };
}

test('a document of an open slab is renewed until the slab has ended, and then never again', async () => {
  const { asked, shown, wait } = followed(whileOpen);
  asked[0].answer(open);
  await settled();
  assert.equal(wait(), kOpen_ms);
  asked[1].answer(ended);
  await settled();
  assert.deepEqual(shown.map((one) => one.document), [open, ended]);
  assert.equal(wait(), null);
  assert.equal(asked.length, 2);
});
test('a document of a slab that has ended is asked for once', async () => {
  const { asked, wait } = followed(whileOpen);
  asked[0].answer(ended);
  await settled();
  assert.equal(wait(), null);
});
test('a renewal without news draws nothing', async () => {
  const { asked, shown, wait } = followed(whileOpen);
  for (let i = 0; i < 3; ++i) {
    asked[i].answer({ ...open });
    await settled();
    assert.equal(wait(), kOpen_ms);
  }
  assert.equal(shown.length, 1);
});
test('a renewal that fails keeps the document, and the next one follows', async () => {
  const { asked, shown, wait } = followed(whileOpen);
  asked[0].answer(open);
  await settled();
  wait();
  asked[1].refuse(new Error('timeout'));
  await settled();
  assert.deepEqual(shown, [{ document: open, error: null }]);
  assert.equal(wait(), kOpen_ms);
  asked[2].answer(ended);
  await settled();
  assert.equal(shown.at(-1).document, ended);
});
test('a first request that is refused is shown and is not repeated', async () => {
  for (const error of [new Error('a fault of the page'), new ApiError(404, 'no such slab'), new ApiError(401, 'expired'), new ApiError(400, 'a filter'),
    new ApiError(500, 'too large'), new ApiError(504, 'too slow'), new ApiError(200, 'unusable')]) {
    const { asked, shown, wait } = followed(whileOpen);
    asked[0].refuse(error);
    await settled();
    assert.deepEqual(shown, [{ document: null, error }]);
    assert.equal(wait(), null);
  }
});
test('a first request that got no document is shown, and repeated until there is one', async () => {
  const { asked, shown, wait } = followed(whileOpen);
  const errors = [new ApiError(0, 'timeout'), new ApiError(503, 'busy')];
  for (const [i, error] of errors.entries()) {
    asked[i].refuse(error);
    await settled();
    assert.equal(wait(), kOpen_ms);
  }
  asked[2].answer(ended);
  await settled();
  assert.deepEqual(shown, [...errors.map((error) => ({ document: null, error })), { document: ended, error: null }]);
  assert.equal(wait(), null);
});
test('again: an answer to an earlier request is not used, and there is one chain of requests', async () => {
  const { asked, shown, wait, again } = followed(whileOpen);
  asked[0].answer(open);
  await settled();
  wait();
  again();
  assert.deepEqual(asked.map((one) => one.signal.aborted), [true, true, false]);
  asked[1].answer(open);
  asked[2].answer(ended);
  await settled();
  assert.deepEqual(shown.map((one) => one.document), [open, ended]);
  assert.equal(wait(), null);
});
test('again: a document of a slab that has ended stays if it fails, and is asked for until there is an answer', async () => {
  const { asked, shown, wait, again } = followed(whileOpen);
  asked[0].answer(ended);
  await settled();
  again();
  asked[1].refuse(new ApiError(0, 'unreachable'));
  await settled();
  assert.equal(wait(), kOpen_ms);
  asked[2].answer({ ...ended, dispositions: 1 });
  await settled();
  assert.deepEqual(shown.map((one) => one.error), [null, null]);
  assert.equal(shown.at(-1).document.dispositions, 1);
  assert.equal(wait(), null);
});
test('nothing is asked or shown after the end', async () => {
  const { asked, shown, wait, end } = followed(whileOpen);
  asked[0].answer(open);
  await settled();
  end();
  assert.equal(wait(), null);
  const late = followed(whileOpen);
  late.end();
  assert.ok(late.asked[0].signal.aborted);
  late.asked[0].answer(open);
  await settled();
  assert.deepEqual([shown.length, late.shown.length, late.wait()], [1, 0, null]);
});
test('a pass of an open slab has no colour of a pass', () => {
  assert.equal(bandVerdict('pass', null), 'none');
  assert.equal(bandVerdict('pass', ended.ended), 'pass');
  assert.equal(bandVerdict('fail', null), 'fail');
  assert.equal(bandVerdict('good', ended.ended), 'none');
});
test('the maps are those of the newest attempt with a result', () => {
  assert.equal(measuredAttempt([{ attempt: 1, result: {} }, { attempt: 2, result: {} }, { attempt: 3 }]), 2);
  assert.equal(measuredAttempt([{ attempt: 1 }]), null);
  assert.equal(measuredAttempt([]), null);
});
