// SPDX-License-Identifier: Apache-2.0
import assert from 'node:assert/strict';
import test from 'node:test';
import { ApiError, onRefused, post, retryAfter } from '../src/api.js';
import { refusalOf } from '../src/pages/login.js';
import { bodyOf, isDecidedMeanwhile, problemOf } from '../src/parts/decision.js';
import { bytesOf, oneLine } from '../src/parts/field.js';
import { reasonProblem } from '../src/parts/scans.js';
import { createSession } from '../src/session.js';
import { say } from '../src/words.js';

const settled = async () => {
  for (let i = 0; i < 20; ++i) await Promise.resolve();
};
const of = (user, login_required = false) => ({ schema: 'slabd.web_session/1', user, login_required });

/// A server whose answers are given by hand, and timers that run by hand.
function world() {
  const asked = [];
  const posts = [];
  const timers = [];
  const pending = (list, more) => new Promise((answer, refuse) => list.push({ ...more, answer, refuse }));
  return {
    asked,
    posts,
    timers,
    ask: () => pending(asked, {}),
    post: (path, body) => pending(posts, { path, body }),
    setTimeout: (call, ms) => timers.push({ call, ms }),
    clearTimeout: () => {},
  };
}

test('the session is asked again after a minute, and sooner after an error', async () => {
  const here = world();
  const session = createSession(here);
  session.again();
  session.again();
  assert.equal(here.asked.length, 1, 'one request at a time');
  here.asked[0].answer(of('mei'));
  await settled();
  assert.equal(session.state().session.user, 'mei');
  assert.equal(here.timers.at(-1).ms, 60_000);
  here.timers.at(-1).call();
  here.asked[1].refuse(new ApiError(0, 'unreachable'));
  await settled();
  assert.equal(session.state().session.user, 'mei', 'the last known session stays');
  assert.equal(session.state().error.message, 'unreachable');
  assert.ok(here.timers.at(-1).ms < 60_000);
});
test('an answer from before a login is not used', async () => {
  const here = world();
  const session = createSession(here);
  session.again();
  const login = session.login('mei', 'right');
  assert.deepEqual([here.posts[0].path, here.posts[0].body], ['/login', { name: 'mei', password: 'right' }]);
  here.posts[0].answer(of('mei'));
  await settled();
  here.asked[1].answer(of('mei'));
  await login;
  here.asked[0].answer(of(null));
  await settled();
  assert.equal(session.state().session.user, 'mei');
  const logout = session.logout();
  here.posts[1].answer(of(null));
  await logout;
  assert.deepEqual([here.posts[1].path, session.state().session.user], ['/logout', null]);
});
test('a refused login keeps the session and is an error', async () => {
  const here = world();
  const session = createSession(here);
  const login = session.login('mei', 'wrong');
  here.posts[0].refuse(new ApiError(401, 'wrong name or password'));
  await assert.rejects(login, { status: 401 });
  assert.equal(session.state().session, null);
});
test('a login that the browser does not send back is an error, and no user is logged in', async () => {
  const here = world();
  const session = createSession(here);
  const login = session.login('mei', 'right');
  here.posts[0].answer(of('mei'));
  await settled();
  assert.equal(session.state().session, null, 'not logged in before the next answer');
  here.asked[0].answer(of(null));
  await assert.rejects(login, { message: 'cookie' });
  assert.equal(session.state().session.user, null);
});
test('a login stays if the server does not answer the next question', async () => {
  const here = world();
  const session = createSession(here);
  const login = session.login('mei', 'right');
  here.posts[0].answer(of('mei'));
  await settled();
  here.asked[0].refuse(new ApiError(0, 'unreachable'));
  await login;
  assert.equal(session.state().session.user, 'mei');
});
test('a document that needs a login asks for the session, once', async () => {
  const here = world();
  const session = createSession(here);
  session.again();
  here.asked[0].answer(of('mei'));
  await settled();
  session.heard(false);
  assert.equal(here.asked.length, 1, 'nothing changed');
  session.heard(true);
  here.asked[1].answer(of(null, true));
  await settled();
  session.heard(true);
  assert.equal(here.asked.length, 2, 'known already');
  session.heard(false);
  assert.equal(here.asked.length, 3, 'logged in on another page');
});

test('post: the request, and an error with the server\'s text, cure and waiting time', async (t) => {
  const requests = [];
  let refusals = 0;
  const end = onRefused(() => ++refusals);
  const answer = (status, body, more = {}) => t.mock.method(globalThis, 'fetch', async (path, options) => {
    requests.push({ path, options });
    return new Response(JSON.stringify(body), { status, headers: more });
  });
  answer(200, { schema: 'slabd.web_done/1', text: 'disposition 1 of slab 5: hold' });
  assert.equal((await post('/slabs/5/disposition', { decision: 'hold' })).text, 'disposition 1 of slab 5: hold');
  const { path, options } = requests[0];
  assert.deepEqual([path, options.method, options.headers, options.credentials, options.body],
    ['/api/v1/slabs/5/disposition', 'POST', { 'Content-Type': 'application/json' }, 'same-origin', '{"decision":"hold"}']);
  answer(429, { schema: 'slabd.web_error/1', status: 429, text: 'too many', cure: 'wait' }, { 'Retry-After': '30' });
  await assert.rejects(post('/login', {}), { status: 429, message: 'too many', cure: 'wait', retry_after_s: 30 });
  assert.equal(refusals, 0);
  answer(401, { schema: 'slabd.web_error/1', status: 401, text: 'expired', cure: '' });
  await assert.rejects(post('/slabs/5/pin', {}), { status: 401, retry_after_s: null });
  assert.equal(refusals, 1);
  answer(200, { schema: 'other' });
  await assert.rejects(post('/slabs/5/pin', {}), { message: 'unusable' });
  end();
});
test('Retry-After is a number of seconds', () => {
  assert.equal(retryAfter('30'), 30);
  for (const text of [null, '', '-1', '1.5', 'Wed, 21 Oct 2026 07:28:00 GMT']) assert.equal(retryAfter(text), null);
});
test('a refused login in the words of the page', () => {
  const t = (key, values) => say('en', key, values);
  assert.equal(refusalOf(new ApiError(401, 'x'), t), 'The name or the password is wrong.');
  assert.equal(refusalOf(new ApiError(429, 'x', '', 30), t), 'Too many attempts. Try again in 30 s.');
  assert.match(refusalOf(new ApiError(0, 'cookie'), t), /allow cookies/);
  assert.equal(refusalOf(new ApiError(403, 'the connection is not encrypted'), t), '');
});

const draft = { decision: 'rework', reason: ' burr at block 4 ', authority: 'Li Wei', second: '' };
test('a decision needs everything that is recorded', () => {
  const problem = (change, second = false) => problemOf({ ...draft, ...change }, second);
  assert.equal(problem({}), null);
  assert.equal(problem({ decision: '' }).field, 'decision');
  assert.equal(problem({ decision: 'pass' }).field, 'decision');
  assert.deepEqual(problem({ reason: '  ' }), { field: 'reason', key: 'form.no_reason' });
  assert.deepEqual(problem({ authority: '' }), { field: 'authority', key: 'decision.no_authority' });
  assert.equal(problem({ second: '' }, true).key, 'decision.no_second');
  assert.equal(problem({ second: 'Li Wei ' }, true).key, 'decision.same_person');
  assert.equal(problem({ second: 'Wang Fang' }, true), null);
});
test('a text has at most 400 bytes, not characters', () => {
  assert.equal(bytesOf('承轨台'), 9);
  assert.equal(problemOf({ ...draft, reason: 'x'.repeat(400) }, false), null);
  assert.deepEqual(problemOf({ ...draft, reason: '台'.repeat(134) }, false), { field: 'reason', key: 'form.too_long', bytes: 402 });
  assert.deepEqual([reasonProblem(' '), reasonProblem('台'.repeat(134)), reasonProblem('complaint 17')], ['form.no_reason', 'form.too_long', '']);
});
test('a text is one line without control characters', () => {
  assert.equal(oneLine('a\r\nb\tc\u0000\u007f'), 'a b c ');
});
test('the second person is sent only if one is needed', () => {
  assert.deepEqual(bodyOf({ ...draft, second: 'Wang Fang ' }, false), { decision: 'rework', reason: 'burr at block 4', authority: 'Li Wei' });
  assert.equal(bodyOf({ ...draft, second: 'Wang Fang ' }, true).second, 'Wang Fang');
});
test('a decision of another user is noticed, the own one that was stored before its answer was lost is not another', () => {
  const body = bodyOf(draft, false);
  const [other, own] = [{ decision: 'hold', reason: 'a', authority: 'b', second: '' }, { ...body, second: '' }];
  assert.equal(isDecidedMeanwhile([other], 1, body), false);
  assert.equal(isDecidedMeanwhile([other, own], 1, body), false);
  assert.equal(isDecidedMeanwhile([other, other], 1, body), true);
  assert.equal(isDecidedMeanwhile([other, other, own], 1, body), true);
  assert.equal(isDecidedMeanwhile([other, own], 0, body), true);
});
