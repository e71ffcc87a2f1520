// SPDX-License-Identifier: Apache-2.0
// Colours of heights: viridis, as in the reports (report/canvas.cpp). Its lightness increases evenly with the value, so
// colour-blind readers and grey prints see the same order.

const kViridis = [[68, 1, 84], [72, 36, 117], [65, 68, 135], [53, 95, 141], [42, 120, 142], [33, 145, 140], [34, 168, 132],
  [68, 191, 112], [122, 209, 81], [189, 223, 38], [253, 231, 37]];

/// Ends of the scale that can be chosen, mm.
export const kScales_mm = [0.05, 0.1, 0.2, 0.5, 1, 2, 5];

/// Red, green, blue (0..255) of a share 0..1 of the scale.
export function colourOf(share) {
  const at = Math.min(1, Math.max(0, share)) * (kViridis.length - 1);
  const low = Math.min(Math.floor(at), kViridis.length - 2);
  return kViridis[low].map((value, i) => value + (at - low) * (kViridis[low + 1][i] - value));
}

/// Colour of a height on the scale -end..+end.
export function heightColour(value_mm, end_mm) {
  return colourOf(0.5 + (0.5 * value_mm) / end_mm);
}

/// The smallest scale that contains 98 % of the values.
export function scaleFor(values) {
  const sizes = values.filter((value) => value !== null).map(Math.abs).sort((a, b) => a - b);
  if (sizes.length === 0) return kScales_mm[0];
  const wanted = sizes[Math.min(sizes.length - 1, Math.floor(0.98 * sizes.length))];
  return kScales_mm.find((scale) => scale >= wanted) ?? kScales_mm.at(-1);
}

/// Seen cells beyond the scale.
export function beyond(values, end_mm) {
  return values.reduce((count, value) => count + (value !== null && Math.abs(value) > end_mm ? 1 : 0), 0);
}
