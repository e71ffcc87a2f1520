// SPDX-License-Identifier: Apache-2.0
// A section through a height map: values along a line through the cursor.

/// A map of slabd.block_map/1 ("deviation" or "seat"), null if it was not stored. Row 0 is the lowest; values go row by
/// row; origin_mm is the centre of the first cell.
export function mapOf(document, which) {
  const stored = document?.[which] ?? null;
  if (stored === null || stored.values_mm?.length !== stored.columns * stored.rows) return null;
  return { columns: stored.columns, rows: stored.rows, cell_mm: stored.cell_mm, origin_mm: stored.origin_mm,
    across: stored.axes[1], values: stored.values_mm };
}

/// Value of a cell, null if nothing was seen or the cell is not on the map.
export function cell(map, column, row) {
  if (column < 0 || row < 0 || column >= map.columns || row >= map.rows) return null;
  return map.values[row * map.columns + column] ?? null;
}

/// Centre of a cell in the block's frame, mm.
export function centre(map, column, row) {
  return [map.origin_mm[0] + column * map.cell_mm, map.origin_mm[1] + row * map.cell_mm];
}

/// Samples {at_mm, value, column, row} along the line through (column, row) with `angle_deg` from the rail (x), one a cell,
/// from one edge of the map to the other. at_mm is 0 at the cursor.
export function section(map, column, row, angle_deg) {
  const angle = (angle_deg * Math.PI) / 180;
  const dx = Math.cos(angle);
  const dy = Math.sin(angle);
  const samples = [];
  const reach = Math.ceil(Math.hypot(map.columns, map.rows));
  for (let step = -reach; step <= reach; ++step) {
    const c = Math.round(column + step * dx);
    const r = Math.round(row + step * dy);
    if (c < 0 || r < 0 || c >= map.columns || r >= map.rows) continue;
    samples.push({ at_mm: step * map.cell_mm, value: cell(map, c, r), column: c, row: r });
  }
  return samples;
}

/// Lowest and highest value of samples, null if there is none.
export function extent(samples) {
  let low = null;
  let high = null;
  for (const { value } of samples) {
    if (value === null) continue;
    if (low === null || value < low) low = value;
    if (high === null || value > high) high = value;
  }
  return { low, high };
}

/// b - a cell by cell; null where one is missing or the maps differ in shape.
export function difference(a, b) {
  if (a === null || b === null) return null;
  if (a.columns !== b.columns || a.rows !== b.rows || a.cell_mm !== b.cell_mm) return null;
  return { ...a, values: a.values.map((value, i) => (value === null || b.values[i] === null ? null : b.values[i] - value)) };
}
