-- SPDX-License-Identifier: Apache-2.0
--
-- From schema version 3 to 4: the maps that reports draw. Older blocks have none. The columns are explained in
-- schema.sql.

CREATE TABLE map (
  slab_key INTEGER NOT NULL,
  station  INTEGER NOT NULL,
  attempt  INTEGER NOT NULL,
  feature  TEXT NOT NULL,
  columns  INTEGER NOT NULL,
  rows     INTEGER NOT NULL,
  cell_mm  REAL NOT NULL,
  step_mm  REAL NOT NULL,
  bytes    BLOB NOT NULL,
  PRIMARY KEY (slab_key, station, attempt, feature),
  FOREIGN KEY (slab_key, station, attempt) REFERENCES block ON DELETE CASCADE
) STRICT;
