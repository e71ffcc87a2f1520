// SPDX-License-Identifier: Apache-2.0
// Texts of the page in its language. Texts of the page itself are in words/en.js and words/zh.js; names of items and
// sentences of reasons come from the server (slabd.web_words/1), which has them from the reports.
import { createContext } from 'preact';
import { useContext } from 'preact/hooks';
import { en } from './words/en.js';
import { zh } from './words/zh.js';
import { visible } from './text.js';

const kCatalogues = { en, zh };

/// The text of `key` with {name} replaced by values. A missing key is shown as itself, so that a test finds it.
export function say(language, key, values = {}) {
  const text = kCatalogues[language]?.[key] ?? kCatalogues.en[key] ?? key;
  return text.replace(/\{(\w+)\}/g, (whole, name) => (name in values ? String(values[name]) : whole));
}

/// {language, t, item, reason}: `served` is the server's slabd.web_words/1 or null.
export function wordsOf(language, served) {
  const t = (key, values) => say(language, key, values);
  return {
    language,
    t,
    has: (key) => key in kCatalogues[language],
    /// Units of a duration.
    units: [t('unit.s'), t('unit.min'), t('unit.h'), t('unit.d')],
    /// The name of a check of the doctor.
    check: (name) => visible(served?.checks?.[name] ?? String(name), 80),
    item: (id) => visible(served?.items?.[id] ?? String(id).replaceAll('_', ' '), 80),
    /// "600: seat slope ...", empty for 0. `text`: the document's own sentence, used until the words have come.
    reason: (code, text = '') => {
      if (!code) return '';
      const sentence = served?.reasons?.[String(code)] || text;
      return sentence ? visible(sentence) : t('reason.code', { code });
    },
  };
}

export const Words = createContext(wordsOf('en', null));
export const useWords = () => useContext(Words);
