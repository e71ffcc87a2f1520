// SPDX-License-Identifier: Apache-2.0
// The frame around every page: header with state and pages, the band that says when nothing may be believed, the page.
import { useEffect, useMemo, useRef, useState } from 'preact/hooks';
import { answerIn, useDocument } from './api.js';
import { duration } from './figures.js';
import { html } from './html.js';
import { About } from './pages/about.js';
import { Block } from './pages/block.js';
import { Calibration } from './pages/calibration.js';
import { Compare } from './pages/compare.js';
import { Drafts } from './pages/drafts.js';
import { Line } from './pages/line.js';
import { Live } from './pages/live.js';
import { Login } from './pages/login.js';
import { Moulds } from './pages/moulds.js';
import { Plant } from './pages/plant.js';
import { Slab } from './pages/slab.js';
import { Slabs } from './pages/slabs.js';
import { Trends } from './pages/trends.js';
import { Unknown } from './pages/unknown.js';
import { Account } from './parts/account.js';
import { useRenewal } from './renew.js';
import { Link, useRoute } from './router.js';
import { useSession } from './session.js';
import { kThemes, store, useTheme } from './settings.js';
import { createSince } from './since.js';
import { Foreign, visible } from './text.js';
import { known } from './verdict.js';
import { Words, useWords, wordsOf } from './words.js';

const kPages = { live: Live, slabs: Slabs, slab: Slab, block: Block, trends: Trends, moulds: Moulds, calibration: Calibration, line: Line,
  compare: Compare, about: About, login: Login, plant: Plant, drafts: Drafts };
const kNavigation = [['live', '/'], ['slabs', '/slabs'], ['trends', '/trends'], ['moulds', '/moulds'], ['plant', '/plant'], ['compare', '/compare'],
  ['calibration', '/calibration'], ['line', '/line'], ['about', '/about']];
/// Shown without a login even if everything else needs one.
const kOpen = ['login', 'about'];
const kBelongsTo = { slab: 'slabs', block: 'slabs', drafts: 'about' };

function useStatus(poll) {
  const [picture, setPicture] = useState(poll.picture());
  useEffect(() => {
    setPicture(poll.picture());
    return poll.listen(setPicture);
  }, [poll]);
  return picture;
}

/// The poll's picture while nothing can be read without a login: it contains no status and is stale only if the page's
/// server does not answer.
function closedPicture(picture) {
  const stale = picture.stale && picture.trouble === 'server';
  return { ...picture, status: null, age_ms: null, stale, trouble: stale ? 'server' : '' };
}

function StaleBand({ picture }) {
  const { t, units } = useWords();
  if (!picture.stale) return null;
  const text = picture.age_ms === null ? t('stale.never') : t('stale.age', { age: duration(picture.age_ms / 1000, units) });
  return html`<div class="band band-stale">
    <strong>${text}</strong>
    <span>${t(picture.trouble === 'server' ? 'stale.server' : picture.trouble === 'login' ? 'login.required' : 'stale.do')}</span>
    ${!['', 'server', 'login'].includes(picture.trouble) && html`<span><${Foreign} text=${picture.trouble} /></span>`}
  </div>`;
}

/// slabd answers, but its database cannot be read.
function TroubleBand({ picture }) {
  const { t } = useWords();
  if (picture.stale || ['', 'server', 'login'].includes(picture.trouble)) return null;
  return html`<div class="band band-trouble"><strong>! ${t('trouble.records')}</strong> <${Foreign} text=${picture.trouble} /></div>`;
}

function EmulationBand({ parts }) {
  const { t, language } = useWords();
  if (!Array.isArray(parts) || parts.length === 0) return null;
  const named = parts.map((part) => t(`emulation.${visible(part, 20)}`)).join(language === 'zh' ? '，' : ', ');
  return html`<div class="band band-emulated">${t('emulation.notice', { parts: named })}</div>`;
}

function FaultBand({ status }) {
  const { t } = useWords();
  const code = status?.fault?.code ?? 0;
  if (!code) return null;
  return html`<div class="band band-fault">
    <strong>✗ ${t('fault.title', { code })}</strong> <span><${Foreign} text=${status.fault.text} /></span>
    <span>→ <${Foreign} text=${status.fault.cure} /></span>
  </div>`;
}

/// Says a new verdict, and that data is stale or fresh again, once each. Nothing is said when the page is opened.
function Announcer({ picture }) {
  const { t } = useWords();
  const [text, setText] = useState('');
  const before = useRef(null);
  const newest = picture.status?.last?.find((slab) => slab.ended);
  const now = { slab: newest ? `${newest.key} ${newest.verdict}` : '', stale: picture.stale, ready: picture.status !== null };
  useEffect(() => {
    const was = before.current;
    // A verdict that came while the data was stale is said when it is fresh again.
    before.current = now.stale && was?.ready ? { ...now, slab: was.slab } : now;
    if (was === null || !was.ready) return;
    if (!now.stale && newest && now.slab !== was.slab)
      setText(t('live.said', { name: visible(newest.slab_id || newest.slab_no, 64), verdict: t(`verdict.${known(newest.verdict)}`) }));
    else if (now.stale !== was.stale) setText(t(now.stale ? 'stale.said' : 'stale.over'));
  }, [now.slab, now.stale, now.ready]);
  return html`<div class="for-readers" role="status" aria-live="polite">${text}</div>`;
}

function Header({ picture, route, closed, plant, theme, setTheme, setLanguage }) {
  const { t, language } = useWords();
  const status = picture.status?.status;
  const state = picture.stale ? t('stale.word') : closed ? '' : t(`state.${visible(status?.state ?? 'init', 30)}`);
  const here = kBelongsTo[route.page] ?? route.page;
  return html`<header class="header">
    <${Link} class="brand" to="/">
      <span class=${`pulse${picture.beats % 2 ? ' pulse-on' : ''}`} aria-hidden="true"></span>slabd<//>
    <span class=${`state-word${status?.state === 'fault' ? ' is-fault' : ''}`}>${state}</span>
    <nav aria-label=${t('app.pages')}><ul>
      ${kNavigation.filter(([page]) => page !== 'plant' || plant).map(([page, to]) => html`<li key=${page}>
        <${Link} to=${to} aria-current=${page === here ? 'page' : undefined}>${t(`page.${page}`)}<//></li>`)}
    </ul></nav>
    <div class="settings">
      <label><span class="for-readers">${t('app.theme')}</span>
        <select value=${theme} onChange=${(event) => setTheme(event.target.value)}>
          ${kThemes.map((name) => html`<option key=${name} value=${name}>${t(`theme.${name}`)}</option>`)}
        </select></label>
      <button type="button" lang=${language === 'en' ? 'zh' : 'en'} onClick=${() => setLanguage(language === 'en' ? 'zh' : 'en')}>
        ${language === 'en' ? '中文' : 'English'}</button>
    </div>
    <${Account} linked=${!closed && route.page !== 'login'} />
  </header>`;
}

export function App({ poll, firstLanguage }) {
  const route = useRoute();
  const { session } = useSession();
  const closed = session?.login_required === true;
  const polled = useStatus(poll);
  const picture = useMemo(() => (closed ? closedPicture(polled) : polled), [closed, polled]);
  const [theme, drawn, setTheme] = useTheme();
  const [language, setLanguage] = useState(firstLanguage);
  const since = useMemo(createSince, []);
  const main = useRef(null);
  const served = useDocument(`/words?language=${language}`, 'slabd.web_words/1', { mark: String(closed) }).document;
  const words = useMemo(() => wordsOf(language, served?.language === language ? served : null), [language, served]);
  const kiosk = route.query.get('kiosk') === '1';
  useRenewal();
  useEffect(() => {
    document.documentElement.lang = language;
    poll.setLanguage(language);
    answerIn(language);
  }, [language]);
  useEffect(() => {
    document.body.dataset.stale = String(picture.stale);
  }, [picture.stale]);
  const asked = kiosk ? 'live' : route.page;
  const login = closed && !kOpen.includes(asked);
  const place = login ? 'login' : `${route.page} ${route.key ?? ''} ${route.station ?? ''}`;
  const first = useRef(true);
  useEffect(() => {
    // A new page is read from its heading, as after loading.
    if (first.current) first.current = false;
    else main.current?.querySelector('h1')?.focus({ preventScroll: true });
    window.scrollTo(0, 0);
  }, [place]);
  const choose = (next) => {
    store('language', next);
    setLanguage(next);
  };
  const Page = login ? Login : kPages[asked] ?? Unknown;
  const status = picture.status?.status;
  return html`<${Words.Provider} value=${words}>
    ${!kiosk && html`<a class="skip" href="#main">${words.t('app.skip')}</a>`}
    <div class=${`frame${kiosk ? ' kiosk' : ''}`}>
      ${!kiosk && html`<${Header} picture=${picture} route=${route} closed=${closed} plant=${session?.plant === true} theme=${theme} setTheme=${setTheme} setLanguage=${choose} />`}
      <aside aria-label=${words.t('app.notices')}>
        <${StaleBand} picture=${picture} />
        <${TroubleBand} picture=${picture} />
        <${EmulationBand} parts=${status?.emulation} />
        <${FaultBand} status=${picture.stale ? null : status} />
      </aside>
      <main id="main" tabindex="-1" ref=${main} class=${`page-${login ? 'login' : asked}`}>
        <${Page} key=${kiosk && !login ? 'live' : place} route=${route} picture=${picture} since=${since} theme=${drawn} kiosk=${kiosk} />
      </main>
      <${Announcer} picture=${picture} />
    </div>
  <//>`;
}
