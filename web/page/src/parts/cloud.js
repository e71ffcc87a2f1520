// SPDX-License-Identifier: Apache-2.0
// Points of a scan (slabd.block_cloud/1): numbers from base64, and their place on a colour scale.

const kMissing = -32768;

/// Little-endian int16 numbers; null if the text is not whole numbers in base64.
export function int16_of(text) {
  let bytes;
  try {
    bytes = atob(text);
  } catch {
    return null;
  }
  if (bytes.length % 2 !== 0) return null;
  const numbers = new Int16Array(bytes.length / 2);
  for (let i = 0; i < numbers.length; ++i) numbers[i] = bytes.charCodeAt(2 * i) | (bytes.charCodeAt(2 * i + 1) << 8);
  return numbers;
}

/// Half the width that contains 98 % of the points, so that stray points do not make the picture small.
function reachOf(positions) {
  const reach = new Float32Array(positions.length / 3);
  for (let i = 0; i < reach.length; ++i) reach[i] = Math.max(Math.abs(positions[3 * i]), Math.abs(positions[3 * i + 1]));
  reach.sort();
  return reach[Math.floor(0.98 * (reach.length - 1))] || 1;
}

/// The cloud of a document, null if it is not usable: {count, read, positions (x, y, z in mm, block frame), values, measured,
/// normal (of the seat), size_mm}. `values`: deviation of each point from the model in mm, NaN without a face nearby; without
/// the slab's recipe, `measured` is false and they are the heights above the seat plane.
export function cloudOf(document) {
  const xyz = int16_of(document?.xyz ?? '');
  if (xyz === null || xyz.length === 0 || xyz.length !== 3 * document.points) return null;
  const positions = new Float32Array(xyz.length);
  for (let i = 0; i < xyz.length; ++i) positions[i] = xyz[i] * document.step_mm + document.origin_mm[i % 3];
  const normal = document.seat?.normal ?? [0, 0, 1];
  const offset_mm = document.seat?.offset_mm ?? 0;
  const values = new Float32Array(document.points);
  const measured = typeof document.deviation === 'string';
  if (measured) {
    const deviation = int16_of(document.deviation);
    if (deviation === null || deviation.length !== values.length) return null;
    for (let i = 0; i < values.length; ++i) values[i] = deviation[i] === kMissing ? NaN : deviation[i] * document.deviation_step_mm;
  } else {
    for (let i = 0; i < values.length; ++i)
      values[i] = normal[0] * positions[3 * i] + normal[1] * positions[3 * i + 1] + normal[2] * positions[3 * i + 2] - offset_mm;
  }
  return { count: document.points, read: document.points_read, positions, values, measured, normal, size_mm: 2 * reachOf(positions) };
}

/// Lowest and highest height of the colours, mm: they contain 98 % of the points.
export function heightRange(values) {
  const sorted = values.filter((value) => !Number.isNaN(value)).sort();
  if (sorted.length === 0) return [0, 1];
  const at = (share) => Math.round(sorted[Math.round(share * (sorted.length - 1))]);
  const [low, high] = [at(0.01), at(0.99)];
  return [low, Math.max(high, low + 1)];
}

/// Place of each value on the scale low..high, 0..1; NaN without a value.
export function sharesOf(values, low, high) {
  return values.map((value) => Math.min(1, Math.max(0, (value - low) / (high - low))));
}

/// Positions with the deviations `factor` times as large, along the seat's normal. Heights are not exaggerated.
export function exaggerated(cloud, factor) {
  if (!cloud.measured || factor === 1) return cloud.positions;
  const out = cloud.positions.slice();
  for (let i = 0; i < cloud.count; ++i) {
    const more = Number.isNaN(cloud.values[i]) ? 0 : (factor - 1) * cloud.values[i];
    for (let axis = 0; axis < 3; ++axis) out[3 * i + axis] += more * cloud.normal[axis];
  }
  return out;
}
