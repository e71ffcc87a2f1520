// SPDX-License-Identifier: Apache-2.0
// Data of the control chart from slabd.trend/1.

/// Columns of uPlot: index, value, lowest, highest, then only the values that break a rule or lie outside the limits.
export function columnsOf(trend) {
  const series = trend.series;
  return [
    series.map((_, i) => i + 1),
    series.map((point) => point.value),
    series.map((point) => point.lowest),
    series.map((point) => point.highest),
    series.map((point) => (point.signal !== 'none' ? point.value : null)),
    series.map((point) => (point.outside > 0 ? (outsideOf(point, trend) ?? point.value) : null)),
  ];
}

/// The limits that are drawn: none if the blocks have different ones.
export const limitsOf = (trend) => (trend.limits_differ ? { lower: null, upper: null } : trend);

/// The extreme value of a slab that lies outside the limits; null if the limits do not show which.
function outsideOf(point, trend) {
  const { lower, upper } = limitsOf(trend);
  if (upper !== null && point.highest > upper) return point.highest;
  if (lower !== null && point.lowest < lower) return point.lowest;
  return null;
}

/// Range of the vertical axis: everything that is drawn, with a margin.
export function rangeOf(trend) {
  const { lower, upper } = limitsOf(trend);
  const values = [lower, upper, trend.chart.lower_control, trend.chart.upper_control];
  for (const point of trend.series) values.push(point.value, point.lowest, point.highest);
  const there = values.filter((value) => typeof value === 'number');
  if (there.length === 0) return [0, 1];
  const low = Math.min(...there);
  const high = Math.max(...there);
  const margin = 0.06 * (high - low || Math.abs(high) || 1);
  return [low - margin, high + margin];
}
