// SPDX-License-Identifier: Apache-2.0
import assert from 'node:assert/strict';
import test from 'node:test';
import { createPoll } from '../src/poll.js';
import { createSince } from '../src/since.js';
import { age, hasSlept, heard, heardNothing, isStale, kStale_ms, looked, slept } from '../src/stale.js';

test('a page that heard nothing is stale', () => {
  assert.equal(isStale(heardNothing(), 0), true);
});
test('the age is that of the answer plus the time since the request', () => {
  const state = heard(heardNothing(), 1000, 400);
  assert.equal(age(state, 1000), 400);
  assert.equal(age(state, 2500), 1900);
  assert.equal(isStale(state, 1000 + kStale_ms - 400), false);
  assert.equal(isStale(state, 1000 + kStale_ms - 399), true);
});
test('an answer of a server that has no answer of slabd is stale', () => {
  for (const age_ms of [null, undefined, NaN, -1, '5']) assert.equal(isStale(heard(heardNothing(), 0, age_ms), 0), true);
});
test('a page that slept believes nothing until an answer comes', () => {
  const asleep = slept(heard(heardNothing(), 0, 0));
  assert.equal(isStale(asleep, 1), true);
  assert.equal(isStale(heard(asleep, 2, 0), 2), false);
});
test('a gap of either clock is a sleep', () => {
  const awake = looked(heard(heardNothing(), 0, 0), 10, 1e12);
  assert.equal(hasSlept(heardNothing(), 6000, 1e12), false, 'the first look');
  assert.equal(looked(awake, 6000, 1e12 + 5990).distrust, true, 'both clocks');
  assert.equal(looked(awake, 210, 1e12 + 8 * 3600e3).distrust, true, 'performance.now() stopped while the computer was suspended');
  assert.equal(looked(awake, 210, 1e12 + 200).distrust, false);
  assert.equal(looked(awake, 210, 1e12 - 3600e3).distrust, false, 'the clock was set back');
});
test('an answer does not hide the gap before it', () => {
  const awake = looked(heard(heardNothing(), 0, 0), 10, 1e12);
  assert.equal(hasSlept(heard(awake, 6000, 0), 6000, 1e12 + 5990), true);
});
test('a clock that stands still or goes back makes no answer younger', () => {
  assert.equal(age(heard(heardNothing(), 1000, 300), 500), 300);
});

/// A world whose time passes only by pass(). In sleep() the clock of the computer advances, and now() does not.
function world(answers) {
  let now = 0;
  let asleep_ms = 1e12;
  let timers = [];
  let id = 0;
  const requests = [];
  return {
    requests,
    now: () => now,
    wall: () => now + asleep_ms,
    sleep: (ms) => (asleep_ms += ms),
    freeze: (ms) => (now += ms),  // time passes, and no timer runs
    setTimeout: (call, ms) => (timers.push({ id: ++id, at: now + ms, call }), id),
    clearTimeout: (which) => (timers = timers.filter((timer) => timer.id !== which)),
    fetch: (path, options) => {
      requests.push({ path, options });
      return answers(requests.length, options);
    },
    async pass(ms) {
      const end = now + ms;
      for (;;) {
        for (let i = 0; i < 20; ++i) await Promise.resolve();
        const next = timers.filter((timer) => timer.at <= end).sort((a, b) => a.at - b.at)[0];
        if (next === undefined) break;
        timers = timers.filter((timer) => timer !== next);
        now = next.at;
        next.call();
      }
      now = end;
    },
  };
}
const good = (age_ms = 100) => Promise.resolve({ ok: true, status: 200, headers: new Map([['ETag', '"1"']]),
  json: () => Promise.resolve({ schema: 'slabd.web_status/1', age_ms, status: {}, trouble: '' }) });
const hangs = (options) => new Promise((_, refuse) => options.signal.addEventListener('abort', () => refuse(new Error('aborted'))));

async function staleAfter(answers, ms) {
  const here = world(answers);
  const poll = createPoll(here);
  poll.start();
  await here.pass(ms);
  const { stale } = poll.picture();
  poll.stop();
  return { stale, here };
}

test('answers every second keep the page fresh', async () => {
  const { stale, here } = await staleAfter(() => good(), 60_000);
  assert.equal(stale, false);
  assert.ok(here.requests.length > 50 && here.requests.length < 62);
});
for (const [name, answers] of [
  ['the server hangs', (n, options) => (n < 4 ? good() : hangs(options))],
  ['the network is gone', (n) => (n < 4 ? good() : Promise.reject(new Error('gone')))],
  ['the JSON is not usable', (n) => (n < 4 ? good() : Promise.resolve({ ok: true, status: 200, headers: new Map(), json: () => Promise.reject(new Error('syntax')) }))],
  ['the document has another schema', (n) => (n < 4 ? good() : Promise.resolve({ ok: true, status: 200, headers: new Map(), json: () => Promise.resolve({ schema: 'x' }) }))],
  ['HTTP 500', (n) => (n < 4 ? good() : Promise.resolve({ ok: false, status: 500, headers: new Map(), json: () => Promise.resolve({}) }))],
  ['slabd is silent: its answer becomes older', (n) => good(n < 4 ? 100 : 100 + 1000 * (n - 3))],
  ['the server answers "not changed"', (n) => (n < 4 ? good() : Promise.resolve({ ok: false, status: 304, headers: new Map() }))],
]) {
  test(`grey within 3 s: ${name}`, async () => {
    // The last good answer came at 2 s.
    assert.equal((await staleAfter(answers, 2100)).stale, false);
    assert.equal((await staleAfter(answers, 5000)).stale, true);
  });
}
test('a missing login is not a silent server', async () => {
  const here = world((n) => (n < 4 ? good() : Promise.resolve({ ok: false, status: 401, headers: new Map() })));
  const poll = createPoll(here);
  poll.start();
  await here.pass(5000);
  const { trouble, stale } = poll.picture();
  assert.deepEqual([trouble, stale], ['login', true]);
  poll.stop();
});
test('fresh again with the first good answer', async () => {
  const { stale } = await staleAfter((n) => (n > 3 && n < 8 ? Promise.reject(new Error('gone')) : good()), 9000);
  assert.equal(stale, false);
});
test('woke: stale at once, and asks at once', async () => {
  const here = world(() => good());
  const poll = createPoll(here);
  poll.start();
  await here.pass(2500);
  const before = here.requests.length;
  poll.woke();
  assert.equal(poll.picture().stale, true);
  assert.equal(here.requests.length, before + 1);
  await here.pass(10);
  assert.equal(poll.picture().stale, false);
  await here.pass(10_000);
  assert.ok(here.requests.length <= before + 12, 'one chain of requests');
  poll.stop();
});
/// A page after three good answers; later ones wait in `pending`. `wakes()`: how often it woke.
async function fresh() {
  const pending = [];
  const here = world((n) => (n < 4 ? good() : new Promise((answer) => pending.push(answer))));
  const poll = createPoll(here);
  let woke = 0;
  poll.onWoke(() => ++woke);
  poll.start();
  await here.pass(2500);
  return { here, poll, pending, wakes: () => woke };
}
test('woke: a page that was hidden for long wakes once', async () => {
  const { here, poll, pending, wakes } = await fresh();
  here.freeze(60_000);
  poll.woke();
  await here.pass(1000);
  assert.deepEqual([wakes(), pending.length], [1, 1]);
  pending[0](good());
  await here.pass(200);
  assert.deepEqual([wakes(), poll.picture().stale], [1, false]);
  poll.stop();
});
test('a computer that was suspended for a night shows nothing of the evening', async () => {
  const { here, poll, pending, wakes } = await fresh();
  assert.deepEqual([poll.picture().stale, wakes()], [false, 0]);
  here.sleep(8 * 3600e3);
  await here.pass(200);
  assert.deepEqual([poll.picture().stale, wakes(), pending.length], [true, 1, 1], 'grey with the first look, and asks at once');
  pending[0](good());
  await here.pass(10);
  assert.deepEqual([poll.picture().stale, wakes()], [false, 1]);
  poll.stop();
});
test('an answer from before a sleep does not count, whether a look or the answer comes first', async () => {
  for (const look_ms of [200, 0]) {
    const pending = [];
    const here = world((n) => (n < 4 ? good() : new Promise((answer) => pending.push(answer))));
    const poll = createPoll(here);
    poll.start();
    await here.pass(3050);
    assert.equal(pending.length, 1);
    here.sleep(8 * 3600e3);
    await here.pass(look_ms);
    pending[0](good());
    await here.pass(10);
    assert.deepEqual([poll.picture().stale, pending.length], [true, 2], `look after ${look_ms} ms`);
    pending[1](good());
    await here.pass(10);
    assert.equal(poll.picture().stale, false);
    poll.stop();
  }
});
test('woke: an answer that was pending does not count', async () => {
  const pending = [];
  const here = world((n, options) => (n < 4 ? good() : new Promise((answer) => pending.push({ answer, signal: options.signal }))));
  const poll = createPoll(here);
  poll.start();
  await here.pass(3050);
  poll.woke();
  assert.equal(pending.length, 2);
  assert.deepEqual(pending.map((one) => one.signal.aborted), [true, false]);
  pending[0].answer(good());
  await here.pass(10);
  assert.deepEqual([poll.picture().stale, poll.picture().trouble], [true, '']);
  pending[1].answer(good());
  await here.pass(10);
  assert.equal(poll.picture().stale, false);
  await here.pass(1000);
  assert.equal(pending.length, 3, 'one chain of requests');
  poll.stop();
});
test('a request that is ended by woke is not trouble of the server', async () => {
  const here = world((n, options) => (n === 4 ? hangs(options) : good()));
  const poll = createPoll(here);
  const troubles = new Set();
  poll.listen((picture) => troubles.add(picture.trouble));
  poll.start();
  await here.pass(3050);
  poll.woke();
  await here.pass(3000);
  assert.deepEqual([[...troubles], poll.picture().stale], [[''], false]);
  poll.stop();
});
test('an answer that took 1.9 s is 1.9 s old', async () => {
  const here = world((n) => (n === 1 ? new Promise((answer) => here.setTimeout(() => answer(good()), 1900)) : hangs(here.requests.at(-1).options)));
  const poll = createPoll(here);
  poll.start();
  await here.pass(1950);
  assert.deepEqual([poll.picture().stale, poll.picture().age_ms], [false, 2000]);
  await here.pass(500);
  assert.equal(poll.picture().stale, false, '2.5 s after the server made it, at most');
  await here.pass(250);
  assert.equal(poll.picture().stale, true);
  poll.stop();
});
test('answers that take a second keep the page fresh', async () => {
  const here = world(() => new Promise((answer) => here.setTimeout(() => answer(good()), 1000)));
  const poll = createPoll(here);
  poll.start();
  await here.pass(1100);
  const seen = new Set();
  for (let i = 0; i < 100; ++i) {
    await here.pass(100);
    seen.add(poll.picture().stale);
  }
  assert.deepEqual([...seen], [false]);
  assert.ok(here.requests.length <= 10, 'one request at a time, with a pause');
  poll.stop();
});
test('another language is asked for at once, in one chain of requests', async () => {
  const here = world(() => good());
  const poll = createPoll(here, 'zh');
  poll.start();
  await here.pass(2500);
  assert.equal(here.requests.at(-1).path, '/api/v1/status?language=zh');
  const before = here.requests.length;
  poll.setLanguage('zh');
  assert.equal(here.requests.length, before);
  poll.setLanguage('en');
  assert.equal(here.requests.length, before + 1);
  const { path, options } = here.requests.at(-1);
  assert.deepEqual([path, options.headers], ['/api/v1/status?language=en', {}]);
  await here.pass(10_000);
  assert.ok(here.requests.length <= before + 12);
  poll.stop();
});
test('stopped: no request and no listener remain', async () => {
  const here = world(() => good());
  const poll = createPoll(here);
  let calls = 0;
  poll.listen(() => ++calls);
  poll.onWoke(() => ++calls);
  poll.start();
  await here.pass(3000);
  poll.stop();
  const [requests, told] = [here.requests.length, calls];
  here.sleep(8 * 3600e3);
  await here.pass(60_000);
  poll.woke();
  assert.deepEqual([here.requests.length, calls], [requests, told]);
});
test('since: a state that was there when the page opened began at least then', () => {
  const since = createSince();
  assert.deepEqual(since.note('plc', 'up', 1000), { for_ms: 0, atLeast: true });
  assert.deepEqual(since.note('plc', 'up', 4000), { for_ms: 3000, atLeast: true });
  assert.deepEqual(since.note('plc', 'down', 5000), { for_ms: 0, atLeast: false });
});
