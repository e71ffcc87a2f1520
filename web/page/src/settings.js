// SPDX-License-Identifier: Apache-2.0
// Language and colours of the page: from the address, else stored by the user, else the browser's preference.
import { useEffect, useState } from 'preact/hooks';

export const kLanguages = ['en', 'zh'];
export const kThemes = ['auto', 'light', 'dark', 'contrast'];

/// The language for `query` (?lang=), `stored`, and the browser's languages, in this order.
export function languageOf(query, stored, browser) {
  for (const wanted of [query, stored])
    if (kLanguages.includes(wanted)) return wanted;
  for (const wanted of browser ?? []) {
    const code = String(wanted).toLowerCase().split('-')[0];
    if (kLanguages.includes(code)) return code;
  }
  return 'en';
}

/// Colours that are drawn for a setting: light, dark or contrast.
export function themeOf(setting, prefersDark, prefersContrast) {
  if (setting !== 'auto' && kThemes.includes(setting)) return setting;
  if (prefersContrast) return 'contrast';
  return prefersDark ? 'dark' : 'light';
}

/// Storage may be refused by the browser; the settings then last as long as the page.
export function stored(name) {
  try {
    return localStorage.getItem(`slabd-${name}`);
  } catch {
    return null;
  }
}

export function store(name, value) {
  try {
    localStorage.setItem(`slabd-${name}`, value);
  } catch {
    // Refused: nothing to do.
  }
}

/// [setting, theme that is drawn, set]. The theme is written to <html data-theme>.
export function useTheme() {
  const [setting, setSetting] = useState(() => (kThemes.includes(stored('theme')) ? stored('theme') : 'auto'));
  const [theme, setTheme] = useState('light');
  useEffect(() => {
    const dark = matchMedia('(prefers-color-scheme: dark)');
    const contrast = matchMedia('(prefers-contrast: more)');
    const apply = () => {
      const now = themeOf(setting, dark.matches, contrast.matches);
      document.documentElement.dataset.theme = now;
      setTheme(now);
    };
    apply();
    dark.addEventListener('change', apply);
    contrast.addEventListener('change', apply);
    return () => {
      dark.removeEventListener('change', apply);
      contrast.removeEventListener('change', apply);
    };
  }, [setting]);
  const set = (next) => {
    store('theme', next);
    setSetting(next);
  };
  return [setting, theme, set];
}
