// SPDX-License-Identifier: Apache-2.0
// Number formats of the page. They are those of slabctl (report/figures.cpp), so that page, terminal and report show the
// same digits; test/figures.test.mjs compares them with the output of slabctl.

export const kNone = '-';

/// Decimals shown: a micrometre, a ten-thousandth of a degree.
export function decimalsOf(unit) {
  return unit === 'deg' ? 4 : 3;
}

/// True if `size` lies exactly between two numbers of `decimals` decimals. The binary fraction of such a number has few
/// digits, so its decimal expansion ends with the 5.
function isTie(size, decimals) {
  const digits = size.toFixed(Math.min(100, decimals + 40));
  const point = digits.indexOf('.');
  return /^50*$/.test(digits.slice(point + 1 + decimals));
}

/// `value` with `decimals` decimals, rounded as C does: the nearest, and of two equally near ones the even one. "-" if
/// the value is not finite; zero has no sign.
export function figure(value, decimals) {
  if (typeof value !== 'number' || !Number.isFinite(value)) return kNone;
  const size = Math.abs(value);
  if (size >= 1e21) return String(value);
  let text = size.toFixed(decimals);
  // toFixed rounds a tie up.
  if (isTie(size, decimals) && Number(text.replace('.', '').slice(-1)) % 2 === 1) {
    const step = 10 ** -decimals;
    text = (Number(text) - step).toFixed(decimals);
  }
  return value < 0 && /[1-9]/.test(text) ? `-${text}` : text;
}

/// Digits of a value, its deviation and its limits: a failed value has enough decimals to differ from the limit that it
/// exceeds. With six extra decimals the difference is a rounding error, and the usual number is returned.
export function digitsOf(item) {
  const usual = decimalsOf(item.unit);
  if (item.verdict !== 'fail' || item.value === null) return usual;
  const limit =
    item.upper !== null && item.value > item.upper ? item.upper
    : item.lower !== null && item.value < item.lower ? item.lower
    : null;
  if (limit === null) return usual;
  let digits = usual;
  while (digits < usual + 6 && figure(item.value, digits) === figure(limit, digits)) ++digits;
  return figure(item.value, digits) === figure(limit, digits) ? usual : digits;
}

export const nominalFigure = (item) => figure(item.nominal, decimalsOf(item.unit));
export const valueFigure = (item) => figure(item.value, digitsOf(item));
export const deviationFigure = (item) => figure(item.deviation, digitsOf(item));

/// An uncertainty is never shown as zero.
export function uncertaintyFigure(item) {
  const text = figure(item.U, decimalsOf(item.unit));
  if (!(item.U > 0) || /[1-9]/.test(text)) return text;
  return decimalsOf(item.unit) === 4 ? '< 0.0001' : '< 0.001';
}

/// "1.3325 .. 1.5486", "<= 1.000", ">= 0.100"; empty if the item has no limits.
export function limitsFigure(item) {
  const digits = digitsOf(item);
  if (item.lower === null && item.upper === null) return '';
  if (item.lower === null) return `<= ${figure(item.upper, digits)}`;
  if (item.upper === null) return `>= ${figure(item.lower, digits)}`;
  return `${figure(item.lower, digits)} .. ${figure(item.upper, digits)}`;
}

/// "1-6, 8, 11-18" of rising numbers.
export function rangesText(numbers) {
  const parts = [];
  for (let i = 0; i < numbers.length; ) {
    let end = i;
    while (end + 1 < numbers.length && numbers[end + 1] === numbers[end] + 1) ++end;
    parts.push(i === end ? `${numbers[i]}` : `${numbers[i]}-${numbers[end]}`);
    i = end + 1;
  }
  return parts.join(', ');
}

const two = (number) => String(number).padStart(2, '0');

/// "2026-11-20 23:28:01 +08:00" of the browser's zone; empty if there is no time. `time`: ISO text or microseconds.
export function localTime(time, withZone = true) {
  if (time === null || time === undefined || time === '' || time === 0) return '';
  const date = new Date(typeof time === 'number' ? time / 1000 : time);
  if (Number.isNaN(date.getTime())) return '';
  const day = `${date.getFullYear()}-${two(date.getMonth() + 1)}-${two(date.getDate())}`;
  const clock = `${two(date.getHours())}:${two(date.getMinutes())}:${two(date.getSeconds())}`;
  if (!withZone) return `${day} ${clock}`;
  const offset = -date.getTimezoneOffset();
  const size = Math.abs(offset);
  return `${day} ${clock} ${offset < 0 ? '-' : '+'}${two(Math.floor(size / 60))}:${two(size % 60)}`;
}

/// A duration in its two largest units: "12 s", "4 min 10 s", "3 h 20 min", "2 d 5 h". `units`: the words of s, min, h, d.
export function duration(seconds, units = ['s', 'min', 'h', 'd']) {
  if (!Number.isFinite(seconds)) return kNone;
  const whole = Math.max(0, Math.floor(seconds));
  const [s, min, h, d] = units;
  if (whole < 60) return `${whole} ${s}`;
  if (whole < 3600) return `${Math.floor(whole / 60)} ${min} ${whole % 60} ${s}`;
  if (whole < 86400) return `${Math.floor(whole / 3600)} ${h} ${Math.floor((whole % 3600) / 60)} ${min}`;
  return `${Math.floor(whole / 86400)} ${d} ${Math.floor((whole % 86400) / 3600)} ${h}`;
}
