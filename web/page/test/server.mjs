// SPDX-License-Identifier: Apache-2.0
// A server for tests and development of the page: dist and recorded documents, with the security headers of slabd-web.
//
//     node test/server.mjs [PORT]      prints "http://127.0.0.1:PORT"; without PORT the system chooses one
//
// GET /_test?name=value changes what it answers; the tests drive the page with it:
//   status=live|silent|gone|hang|garbage|closed   as usual; slabd silent; slabd never answered; no answer; not JSON; HTTP 500
//   slab=none|open|pass|fail|odd|whole   the slab of the live page; odd: every verdict; whole: failed, but all its blocks passed
//   id=TEXT         SLAB_ID of the live slab and of the first row of the history
//   done=N          stations of the open slab that have been measured
//   database=1|0    0: every document that is read from the database is an error
//   fault=CODE      fault of the daemon
//   newest="KEY VERDICT"   the first row of the history
//   users=1|0       0: no users are configured
//   required=1|0    1: nothing can be read without a login
//   second=1|0      1: a decision needs a second person
//   cookie=1|0      0: the browser gets no cookie with a login, as if it refused it
//   arms=1|2        2: two robots with a scanner each, the second scanner offline
//   limits=1|0      0: the blocks of a trend have different limits, and values with other limits were left out
//   ended=1|0       0: the stored slabs have not ended, and all their blocks have passed so far
//   attempts=1|2    2: the stored blocks have a second attempt, which failed
//   refuse=STATUS   every POST except login and logout is refused with this status
//   reports=1       answers the CSP reports and errors that the page sent
//
// Users: "mei" (quality) and "wei" (viewer), both with the password "right"; after 5 wrong passwords Retry-After 30.
import { randomUUID } from 'node:crypto';
import { createServer } from 'node:http';
import { readFile } from 'node:fs/promises';
import { join } from 'node:path';

const here = import.meta.dirname;
const dist = process.env.SLABD_PAGE_DIST ?? join(here, '..', 'dist');
const fixture = async (name) => JSON.parse(await readFile(join(here, 'fixtures', `${name}.json`), 'utf8'));
const names = ['status', 'history', 'slab_pass', 'slab_fail', 'stations_pass', 'stations_fail', 'capability', 'trend', 'yield', 'reasons',
  'comparison', 'doctor', 'words_en', 'words_zh', 'calibration', 'moulds', 'block_map_4', 'block_map_11', 'block_cloud', 'findings_en', 'findings_zh'];
const documents = Object.fromEntries(await Promise.all(names.map(async (name) => [name, await fixture(name)])));

const headers = {
  'Content-Security-Policy':
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; connect-src 'self'; " +
    "require-trusted-types-for 'script'; trusted-types 'none'; frame-ancestors 'none'; base-uri 'none'; form-action 'self'; " +
    'report-uri /_report',
  'X-Content-Type-Options': 'nosniff',
  'Referrer-Policy': 'no-referrer',
  'Cross-Origin-Resource-Policy': 'same-origin',
};
const types = { html: 'text/html; charset=utf-8', js: 'text/javascript; charset=utf-8', css: 'text/css; charset=utf-8',
  svg: 'image/svg+xml', txt: 'text/plain; charset=utf-8' };

const start = { status: 'live', slab: 'fail', id: null, done: '7', database: '1', fault: '0', newest: '', users: '1', required: '0',
  second: '0', refuse: '', cookie: '1', limits: '1', arms: '1', ended: '1', attempts: '1' };
let now = { ...start };
/// A PNG picture of one pixel.
const kPixel = 'iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mNk+M9QDwADhgGAWjR9awAAAABJRU5ErkJggg==';
let silent_since = 0;
const reports = [];
const roles = { mei: 'quality', wei: 'viewer' };
let logins = new Map();
let wrong = 0;
/// Decisions and pins that were sent, by the slab's key.
let decisions = new Map();
let pins = new Map();

function forget() {
  logins = new Map();
  wrong = 0;
  decisions = new Map();
  pins = new Map();
}

function mapOf(which, language = 'en') {
  const slab = documents[which === 'pass' ? 'slab_pass' : 'slab_fail'];
  const map = {
    schema: 'slabd.slab_map/1', language, key: slab.key, slab_id: now.id ?? slab.slab_id, slab_no: slab.slab_no, slab_type: slab.slab_type,
    recipe: slab.recipe, emulated: slab.emulated, emulation: slab.emulation, verdict: slab.verdict, reason: slab.reason, reason_text: '',
    began_utime_us: Date.parse(slab.began) * 1000, ended_utime_us: Date.parse(slab.ended) * 1000,
    blocks: documents[['pass', 'whole'].includes(which) ? 'stations_pass' : 'stations_fail'].map((one) => ({ ...one, reason_text: '', attempts: 1, damage: 0, scan_kept: true })),
    findings: which === 'pass' ? [] : documents[`findings_${language}`],
  };
  if (which === 'whole') map.findings = [{ ...map.findings[0], stations: [] }];
  map.findings_count = map.findings.length;
  if (which === 'odd') {
    const verdicts = ['pass', 'fail', 'indeterminate', 'not_measured', 'none'];
    map.blocks = map.blocks.map((block, i) => ({ ...block, verdict: verdicts[i % 5], reason: [0, 600, 604, 401, 0][i % 5] }));
  }
  if (which === 'open') {
    Object.assign(map, { key: 61, slab_no: documents.status.slab.no, slab_id: now.id ?? 'C3-4161', verdict: 'none', reason: 0, ended_utime_us: null,
      findings: [], findings_count: 0 });
    map.blocks = map.blocks.map((block) => ({ ...block, verdict: block.station <= Number(now.done) ? (block.station === 4 ? 'fail' : 'pass') : 'none',
      reason: block.station === 4 && Number(now.done) >= 4 ? 600 : 0 }));
  }
  return map;
}

const faults = { en: { text: 'the clock was set back', cure: 'set the clock (NTP)' }, zh: { text: '时钟被拨回', cure: '校准时钟（NTP）' } };

function webStatus(language) {
  const status = structuredClone(documents.status);
  Object.assign(status, armsIn(status));
  if (now.slab === 'open')
    Object.assign(status.slab, { id: now.id ?? 'C3-4161', stations_done: Number(now.done), current_station: Number(now.done) + 1 });
  else Object.assign(status, { slab: null, state: 'idle' });
  if (now.fault !== '0') Object.assign(status, { state: 'fault', fault: { code: Number(now.fault), ...faults[language] } });
  const age_ms = now.status === 'gone' ? null : now.status === 'silent' ? Date.now() - silent_since : 120;
  const last = documents.history.slabs.slice(0, 8).map((slab, i) => ({ ...withDecision(slab), slab_id: i === 0 && now.id !== null ? now.id : slab.slab_id }));
  const [newest, verdict] = now.newest.split(' ');
  if (newest !== '') Object.assign(last[0], { key: Number(newest), verdict });
  return {
    schema: 'slabd.web_status/1', utime_us: Date.now() * 1000, age_ms, reachable: age_ms !== null && age_ms < 1500,
    trouble: now.status !== 'live' ? 'connect: Connection refused' : now.database === '0' ? 'the database cannot be opened' : '', status: now.status === 'gone' ? null : status,
    map: now.slab === 'none' ? null : mapOf(now.slab), last: now.slab === 'none' ? [] : last,
    yield: now.slab === 'none' ? null : documents.yield.groups.at(-2), slabd_web: { version: '1.0.0', language: 'en' },
  };
}

/// The arms of the line, and the tie of two.
function armsIn(status) {
  const arm = (id, online) => ({ robot: id, scanner: id, pose: status.links.pose,
    scanner_link: { online, strays: 0, text: online ? '' : 'no gateway is connected' },
    calibration: { ...documents.calibration.state.in_force, id: id === '1' ? documents.calibration.state.in_force.id : 'he-of-the-second' },
    acceptance: documents.calibration.state.in_force.scanner, temperature_c: id === '1' ? null : 33.5 });
  if (now.arms !== '2') return { arms: [arm('1', status.links.scanner.online)], tie: null };
  return { arms: [arm('1', true), arm('2', false)],
    tie: { id: 'ti-5ad0c2', robot: '2', expires_utime_us: 1_780_000_000_000_000, trouble: '' } };
}

/// A row of the history with the newest decision that was sent about its slab.
const withDecision = (row) => ({ ...row, disposition: decisions.get(row.key)?.at(-1).decision ?? row.disposition });

const tokenOf = (request) => /(?:^|; )slabd_test=([\w-]+)/.exec(request.headers.cookie ?? '')?.[1] ?? '';

function sessionOf(user) {
  const role = roles[user] ?? null;
  return { schema: 'slabd.web_session/1', user, role, may_login: now.users === '1', login_required: now.required === '1' && user === null,
    may_write: role === 'quality', second_person: now.second === '1', plant: true, expires_s: user === null ? null : 28800 };
}

/// Two lines with a month of slabs.
function plant() {
  const lines = ['hall-1', 'hall-2'];
  const days_of = Array.from({ length: 20 }, (_, i) => new Date(Date.now() - i * 86400000).toISOString().slice(0, 10))
    .flatMap((day, i) => lines.map((line, k) => ({ line, day, first: 118 + i % 5, passed: 112 + (i * (k + 2)) % 7 })));
  return {
    schema: 'slabd.plant_overview/1', days: 30, days_of,
    lines: lines.map((line, k) => ({ line, slabs: 3500 + k, first: 3420, passed: 3301 + k, share: (3301 + k) / 3420, newest_utime_us: Date.now() * 1000,
      received_utime_us: Date.now() * 1000, troubles: k })),
    pareto: ['jaw_distance', 'seat_slope', 'casing_spacing'].map((item, i) => ({ line: lines[i % 2], item, failed: 40 - 11 * i, indeterminate: 7, not_measured: i, slabs: 38 - 11 * i })),
    moulds: [3, 17, 8].map((mould, i) => ({ mould, slab_type: 5600, item: 'jaw_distance', n: 31 + i, mean: 0.21 - 0.4 * (i % 2), sd: 0.09, lines: 1 + i % 2 })),
  };
}

function foundSlab(slab_id) {
  const one = (line, verdict, items) => ({ line, slab_key: 55, slab_type: 5600, mould: 3, ended_utime_us: 1763999999000000, verdict, reason: items.length ? 604 : 0,
    disposition: items.length ? 'rework' : null, software: 'slabd 1.0.0', items });
  const item = { item: 'jaw_distance', station: 4, station_to: 0, verdict: 'fail', value: 381.4, nominal: 380.5, lower: 380, upper: 381, u: 0.05 };
  return { schema: 'slabd.plant_found/1', slab_id, slabs: slab_id === 'none' ? [] : [one('hall-2', 'pass', []), one('hall-1', 'fail', [item])] };
}

const drafts = () => ({ schema: 'slabd.recipe_drafts/1', folder: '/etc/slabd/recipes/drafts',
  drafts: ['p4925', 'p5600'].map((name, i) => ({ name, written_utime_us: 1763999999000000 - i * 86400000000, file: `${name}.stp`, sha256: 'ab'.repeat(32),
    blocks: 18 - 2 * i, found: 28, not_found: i, remarks: i })),
  passed_over: [{ file: 'old.json', why: 'expected is a slabd.cad_draft/1' }] });

function draftOf(name) {
  if (name !== 'p4925' && name !== 'p5600') return null;
  const found = [['block.cant_ratio', 40], ['block.jaw_half_distance_mm', 190.00000000000003], ['slab.pitch_mm', 630]];
  return { schema: 'slabd.cad_draft/1', file: `${name}.stp`, sha256: 'ab'.repeat(32), unit: 'mm', solids: 1, faces: 512, blocks: 18, reference_height_mm: 10,
    confined: true, draft: `${name}.toml`, picture: `${name}.png`, found: found.map(([key, value]) => ({ key, value, faces: [3, 7, 12], note: 'mean of 18 blocks' })),
    not_found: [{ key: 'block.casing_inner_y_mm', why: 'block 4 has no inner casing' }], remarks: ['block 4 has no inner casing'],
    named_faces: [{ name: 'seat_1', face: 3 }] };
}

const refusal = (status, text, cure = '') => ({ status, body: { schema: 'slabd.web_error/1', status, text, cure } });
const done = (text) => ({ status: 200, body: { schema: 'slabd.web_done/1', text } });

function login(body, token) {
  const { name, password } = body;
  if (wrong >= 5) return { ...refusal(429, 'too many attempts to log in'), more: { 'Retry-After': '30' } };
  if (!(name in roles) || password !== 'right') {
    ++wrong;
    return refusal(401, 'wrong name or password');
  }
  wrong = 0;
  logins.delete(token);
  const next = randomUUID();
  logins.set(next, name);
  if (now.cookie === '0') return { status: 200, body: sessionOf(name) };
  return { status: 200, body: sessionOf(name), more: { 'Set-Cookie': `slabd_test=${next}; HttpOnly; SameSite=Strict; Path=/` } };
}

function decide(key, body, user) {
  const slab = documentOf(`/slabs/${key}`, new URLSearchParams());
  if (slab === null) return refusal(404, 'the database has no such slab', 'see the list of slabs');
  if (slab.verdict === 'pass') return refusal(409, `slab ${key} passed: decisions are about slabs that did not pass`);
  if (!body.reason || !body.authority) return refusal(400, 'the reason is missing: a decision needs it');
  if (now.second === '1' && (!body.second || body.second === body.authority))
    return refusal(400, 'the second person is the authority: two persons must decide');
  const one = { n: slab.dispositions.length + 1, utime: new Date().toISOString(), who: user, decision: body.decision, reason: body.reason,
    authority: body.authority, second: body.second ?? '' };
  decisions.set(key, [...(decisions.get(key) ?? []), one]);
  return done(`disposition ${one.n} of slab ${key}: ${one.decision}`);
}

/// {status, body, more?} of a POST.
function posted(path, body, token) {
  const user = logins.get(token) ?? null;
  if (path === '/login') return login(body, token);
  if (path === '/logout') {
    logins.delete(token);
    return { status: 200, body: sessionOf(null), more: { 'Set-Cookie': 'slabd_test=; Max-Age=0; Path=/' } };
  }
  const found = /^\/slabs\/(\d+)\/(disposition|pin|unpin)$/.exec(path);
  if (found === null) return refusal(404, 'nothing can be sent to this path');
  if (user === null) return refusal(401, 'the login has expired', 'log in');
  if (roles[user] !== 'quality') return refusal(403, 'the role viewer must not change anything', 'log in as a user with the role quality');
  if (now.refuse !== '') return refusal(Number(now.refuse), 'slabd does not answer', 'check: systemctl status slabd');
  const key = Number(found[1]);
  if (found[2] === 'disposition') return decide(key, body, user);
  if (found[2] === 'pin') pins.set(key, { reason: body.reason, pinned: new Date().toISOString(), user: 990 });
  else pins.delete(key);
  return done(`slab ${key}: its scans ${found[2] === 'pin' ? `are kept: ${body.reason}` : 'may be deleted again'}`);
}

async function textOf(request) {
  let text = '';
  for await (const part of request) text += part;
  return text;
}

/// A slabd.slab/1 as set by `ended`.
function atItsTime(slab) {
  if (now.ended === '1') return slab;
  const station_verdicts = slab.station_verdicts.map((one) => ({ ...one, verdict: 'pass', reason: 0 }));
  return { ...slab, ended: null, verdict: 'none', reason: 0, acknowledged: false, items: [], station_verdicts };
}

/// The attempts of a block as set by `attempts`; the second one has too few points.
function attemptsOf(block) {
  if (now.attempts === '1') return [block];
  const { result, ...scanned } = block;
  return [{ ...block, valid: false }, { ...scanned, attempt: block.attempt + 1, valid: true, code: 401, final_verdict: 'not_measured', final_reason: 401 }];
}

/// The document of an address of the interface, or null.
function documentOf(path, query) {
  const block = /^\/slabs\/(\d+)\/blocks\/(\d+)(\/map|\/cloud)?$/.exec(path);
  if (block !== null) {
    const station = Number(block[2]);
    if (block[3] === '/cloud') return station === 11 ? null : { ...documents.block_cloud, key: Number(block[1]), station };
    if (block[3]) return station === 7 ? null : { ...documents[station === 11 ? 'block_map_11' : 'block_map_4'], key: Number(block[1]), station };
    const slab = structuredClone(documents.slab_fail);
    slab.key = Number(block[1]);
    const near = slab.blocks.find((one) => one.station === station) ?? slab.blocks.find((one) => one.station === 3);
    slab.blocks = attemptsOf({ ...near, station });
    if (now.attempts === '2') Object.assign(slab.station_verdicts[station - 1], { verdict: 'not_measured', reason: 401 });
    return atItsTime(slab);
  }
  const slab = /^\/slabs\/(\d+)(\/map|\/pin)?$/.exec(path);
  if (slab !== null) {
    const passed = Number(slab[1]) === documents.slab_pass.key;
    if (Number(slab[1]) > 9000) return null;
    if (slab[2] === '/pin')
      return { schema: 'slabd.pin_state/1', key: Number(slab[1]), slab_id: now.id ?? 'C3-4155', scans: 18, scans_there: Number(slab[1]) < 50 ? 0 : 17,
        pin: pins.get(Number(slab[1])) ?? null };
    if (slab[2]) {
      const map = mapOf(passed || now.ended === '0' ? 'pass' : now.slab === 'whole' ? 'whole' : 'fail', query.get('language') ?? 'en');
      return { ...map, ...(now.ended === '0' && { verdict: 'none', ended_utime_us: null }), key: Number(slab[1]) };
    }
    const document = structuredClone(documents[passed ? 'slab_pass' : 'slab_fail']);
    const dispositions = [...document.dispositions, ...(decisions.get(Number(slab[1])) ?? [])];
    return { ...atItsTime(document), key: Number(slab[1]), slab_id: now.id ?? document.slab_id, dispositions };
  }
  switch (path) {
    case '/slabs': {
      const matching = documents.history.slabs.filter((one) => (!query.get('verdict') || one.verdict === query.get('verdict')) &&
        (!query.get('id') || one.slab_id.includes(query.get('id'))));
      const slabs = matching.map(withDecision).map((one, i) => (i === 0 && now.id !== null ? { ...one, slab_id: now.id } : one));
      return { ...documents.history, slabs: slabs.slice(0, Number(query.get('limit') ?? 20)) };
    }
    case '/trends': return documents.capability;
    case '/yield': return documents.yield;
    case '/reasons': return documents.reasons;
    case '/compare': return { ...documents.comparison, rows: documents.comparison.rows.filter((row) => query.get('all') === '1' || row.en > 1) };
    case '/calibration': return documents.calibration;
    case '/moulds': return documents.moulds;
    case '/plant': return plant();
    case '/plant/slab': return foundSlab(query.get('id'));
    case '/drafts': return drafts();
    case '/doctor': return documents.doctor;
    case '/words': return documents[query.get('language') === 'zh' ? 'words_zh' : 'words_en'];
    default:
      if (path.startsWith('/drafts/')) return draftOf(path.slice(8));
      return path.startsWith('/trends/') ? { ...documents.trend, item: path.slice(8), ...(now.limits === '0' && { limits_differ: true, other_limits: 12 }) } : null;
  }
}

function answer(response, status, type, body, more = {}) {
  response.writeHead(status, { ...headers, 'Content-Type': type, 'Cache-Control': 'no-cache', ...more });
  response.end(body);
}
const json = (response, status, body, more = {}) => answer(response, status, 'application/json', JSON.stringify(body), more);

async function serve(request, response) {
  const url = new URL(request.url, 'http://127.0.0.1');
  if (url.pathname === '/_test') {
    if (url.searchParams.get('reset')) {
      now = { ...start };
      forget();
    }
    for (const [name, value] of url.searchParams) if (name in now) now[name] = value;
    if (url.searchParams.get('status') === 'silent') silent_since = Date.now();
    if (url.searchParams.get('reports')) return json(response, 200, reports.splice(0));
    return json(response, 200, now);
  }
  if (url.pathname === '/_report') {
    reports.push(await textOf(request));
    return answer(response, 204, 'text/plain', '');
  }
  if (url.pathname === '/healthz') return answer(response, 200, 'text/plain', 'ok');
  if (request.method === 'POST') {
    if (request.headers['content-type'] !== 'application/json') return json(response, 415, refusal(415, 'the body must be application/json').body);
    const { status, body, more } = posted(url.pathname.slice(7), JSON.parse(await textOf(request)), tokenOf(request));
    return json(response, status, body, more);
  }
  const user = logins.get(tokenOf(request)) ?? null;
  if (url.pathname === '/api/v1/session') return json(response, 200, sessionOf(user));
  if (url.pathname.startsWith('/api/v1/') && sessionOf(user).login_required)
    return json(response, 401, refusal(401, 'a login is required', 'log in').body);
  if (url.pathname === '/api/v1/status') {
    if (now.status === 'hang') return undefined;
    if (now.status === 'garbage') return answer(response, 200, 'application/json', '{"schema":"slabd.web_status/1","age');
    if (now.status === 'closed') return json(response, 500, { schema: 'slabd.web_error/1', status: 500, text: 'closed', cure: '' });
    return json(response, 200, webStatus(url.searchParams.get('language') === 'zh' ? 'zh' : 'en'));
  }
  if (url.pathname === '/api/v1/drafts/p4925/picture.png') return answer(response, 200, 'image/png', Buffer.from(kPixel, 'base64'));
  if (url.pathname.startsWith('/api/v1/')) {
    const document = now.database === '0' ? null : documentOf(url.pathname.slice(7), url.searchParams);
    return document !== null ? json(response, 200, document)
      : json(response, now.database === '0' ? 503 : 404, { schema: 'slabd.web_error/1', status: 404, text: 'the database has no such slab', cure: 'see the list of slabs' });
  }
  const asset = /^\/assets\/([a-z]+\.(js|css|svg|txt))$/.exec(url.pathname);
  try {
    if (asset !== null) return answer(response, 200, types[asset[2]], await readFile(join(dist, asset[1])));
    return answer(response, 200, types.html, await readFile(join(dist, 'index.html')));
  } catch {
    return answer(response, 404, 'text/plain', 'not found');
  }
}

const server = createServer((request, response) => {
  serve(request, response).catch((error) => {
    console.error(error);
    response.destroy();
  });
});
server.listen(Number(process.argv[2] ?? 0), '127.0.0.1', () => console.log(`http://127.0.0.1:${server.address().port}`));
