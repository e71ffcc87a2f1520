// SPDX-License-Identifier: Apache-2.0
// What the operator looks at all day. It must be readable from three metres within a second: the slab's verdict and map
// first, then what did not pass, then links, yield and the last slabs.
import { useDocument } from '../api.js';
import { duration, figure, localTime } from '../figures.js';
import { html } from '../html.js';
import { FindingList, findingsOf, isBad } from '../parts/findings.js';
import { LinkTable } from '../parts/links.js';
import { PageHead, Panel } from '../parts/panel.js';
import { blocksOf, Legend, SlabMap } from '../parts/slab_map.js';
import { SlabRows } from '../parts/slab_rows.js';
import { Link } from '../router.js';
import { Foreign } from '../text.js';
import { known, symbol } from '../verdict.js';
import { useWords } from '../words.js';

/// The verdict in letters as large as the screen allows. A stale page shows that it is stale instead. Just after SLAB_END
/// the newest map may be that of before it, without a verdict.
function Verdict({ map, open, stale, age_ms }) {
  const { t, units, reason } = useWords();
  const verdict = known(map?.verdict);
  const isJudged = !open && (map?.ended_utime_us ?? null) !== null;
  if (stale)
    return html`<div class="big big-stale" data-slab-verdict=${verdict}>
      <span class="big-word">${t('stale.word')}</span>
      <span class="big-note">${age_ms === null ? t('stale.never') : t('stale.age', { age: duration(age_ms / 1000, units) })}${
        isJudged ? ` · ${t('stale.last')}: ${symbol(verdict)} ${t(`verdict.${verdict}`)}` : ''}</span>
    </div>`;
  if (!isJudged) return null;
  return html`<div class=${`big v-${verdict}`} data-slab-verdict=${verdict}>
    <span class="big-word"><span aria-hidden="true">${symbol(verdict)} </span>${t(`verdict.${verdict}`)}</span>
    ${verdict !== 'pass' && map.reason ? html`<span class="big-note">${reason(map.reason, map.reason_text)}</span>` : ''}
  </div>`;
}

function Progress({ slab }) {
  const { t } = useWords();
  const done = slab?.stations_done ?? 0;
  const all = slab?.stations ?? 0;
  return html`<div class="big big-open" data-slab-verdict="none">
    <span class="big-word">${t('live.scanned', { done, all })}</span>
    <span class="big-note">${slab?.current_station ? t('live.current', { station: slab.current_station }) : ''}</span>
    <progress max=${all} value=${done} aria-label=${t('live.scanned', { done, all })}></progress>
  </div>`;
}

function Today({ row }) {
  const { t } = useWords();
  if (!row || row.inspected === 0) return html`<p class="quiet">${t('live.today_none')}</p>`;
  return html`<div class="today">
    <p class="today-yield"><span class="huge">${figure(row.yield_percent, 1)}</span> <span>%</span>
      ${' '}<span class="quiet">${t('live.first_pass')}</span></p>
    <p class="quiet">${t('live.interval', { low: figure(row.yield_low_percent, 1), high: figure(row.yield_high_percent, 1) })}</p>
    <dl class="counts">
      ${[['pass', 'passed'], ['fail', 'failed'], ['indeterminate', 'undecided'], ['not_measured', 'not_measured']].map(
        ([verdict, field]) => html`<div key=${field} class=${row[field] > 0 ? `v-${verdict}` : 'v-none'}>
          <dt><span aria-hidden="true">${symbol(verdict)}</span> ${t(`verdict.${verdict}`)}</dt><dd>${row[field]}</dd></div>`)}
    </dl>
    ${row.main_reason && html`<p>${t('live.reason', { reason: '' })}<${Foreign} text=${row.main_reason} /></p>`}
  </div>`;
}

function Warnings({ status }) {
  const { t, language } = useWords();
  const bits = status?.warn_bits ?? 0;
  const own = Array.from({ length: 16 }, (_, bit) => bit).filter((bit) => bits & (1 << bit));
  const texts = language === 'en' ? status?.warn ?? [] : own.map((bit) => t(`warn.${bit}`));
  if (texts.length === 0) return null;
  return html`<${Panel} title=${`${t('warnings.title')} (${texts.length})`} className="panel-warnings">
    <ul class="warnings">${texts.map((text, i) => html`<li key=${i}><span aria-hidden="true">! </span><${Foreign} text=${text} /></li>`)}</ul>
  <//>`;
}

/// The map with sentences in the page's language. The status has them in the server's; in another language they are asked
/// for when the slab or its verdicts change.
function useMap(map, language) {
  const foreign = map !== null && map.language !== undefined && map.language !== language;
  const mark = foreign ? `${map.key} ${map.verdict} ${map.findings_count} ${map.blocks.map((block) => `${block.verdict}${block.attempts}`)}` : '';
  const ask = useDocument(foreign ? `/slabs/${map.key}/map?language=${language}` : null, 'slabd.slab_map/1', { mark });
  if (!foreign) return map;
  return ask.document?.key === map.key && !ask.loading ? { ...map, findings: ask.document.findings } : { ...map, findings: [] };
}

export function Live({ picture, since, kiosk }) {
  const words = useWords();
  const { t, language } = words;
  const { status: web, stale } = picture;
  const status = web?.status;
  const slab = status?.slab ?? null;
  const open = slab !== null;
  const newest = useMap(web?.map ?? null, language);
  // Just after SLAB_BEGIN the newest map may still be that of the previous slab.
  const map = open && newest !== null && (newest.ended_utime_us !== null || newest.slab_no !== slab.no) ? null : newest;
  const current = open && !stale ? slab.current_station : 0;
  const key = map?.key ?? null;
  const blocks = map ? blocksOf(map) : open
    ? Array.from({ length: slab.stations }, (_, i) => ({ station: i + 1, verdict: 'none', reason: 0 })) : [];
  const id = open ? slab.id || slab.no : map ? map.slab_id || map.slab_no : null;
  const ended = map?.ended_utime_us ?? null;
  const facts = [
    (open || map) && `${t('field.type')} ${open ? slab.type : map.slab_type}`,
    (open || map) && `${t('field.recipe')} ${open ? slab.recipe : map.recipe}`,
    !open && ended !== null ? `${t('live.ended')} ${localTime(ended, false)}` : '',
  ].filter(Boolean);
  const linkKey = kiosk ? null : key;
  return html`
    <${PageHead} title=${t('live.title')}>
      <p class="clock">${web?.utime_us ? localTime(web.utime_us, false) : ''}</p>
    <//>
    <div class="live">
      <section class="live-slab" aria-labelledby="live-slab-name">
        <div class="slab-name">
          <h2 id="live-slab-name"><span class="quiet">${t(open ? 'live.now' : 'live.last')}</span>
            ${id !== null ? html` <span class="slab-id"><${Foreign} text=${id} max=${64} /></span>` : ''}</h2>
          <p class="quiet"><${Foreign} text=${facts.join(' · ')} />
            ${linkKey && !open ? html` · <${Link} to=${`/slabs/${key}`}>${t('live.open')}<//>` : ''}</p>
        </div>
        ${open && !stale ? html`<${Progress} slab=${slab} />`
          : html`<${Verdict} map=${map} open=${open} stale=${stale} age_ms=${picture.age_ms} />`}
        ${blocks.length > 0
          ? html`<${SlabMap} blocks=${blocks} slabKey=${linkKey} current=${current} stale=${stale} /><${Legend} />`
          : html`<div class="nothing"><p class="huge">${t('live.no_slab')}</p><p class="quiet">${t('live.no_slab_text')}</p></div>`}
        ${map && html`<div class="live-findings"><h3>${t('live.findings')}</h3>
          <${FindingList} findings=${findingsOf(map, words)} count=${map.findings_count} slabKey=${linkKey} max=${6}
            empty=${isBad(map) || map.findings_count > 0 ? html`${t('app.loading')} …` : t('live.no_findings')} /></div>`}
      </section>
      <div class="live-last">
        <${Panel} title=${t('live.last_slabs')}>
          <${SlabRows} caption=${t('live.last_slabs')} slabs=${web?.last ?? []} short linked=${!kiosk} hideCaption empty=${t('live.no_slab')} />
        <//>
      </div>
      <div class="live-side">
        <${Panel} title=${t('live.links')}>
          <${LinkTable} status=${status} since=${since} caption=${t('line.links_caption')} now_ms=${performance.now()} compact />
        <//>
        <${Panel} title=${t('live.today')}><${Today} row=${web?.yield} /><//>
        <${Warnings} status=${status} />
      </div>
    </div>`;
}
