-- SPDX-License-Identifier: Apache-2.0
--
-- From schema version 8 to 9. The columns are explained in schema.sql.

CREATE TABLE noise_print (
  id       INTEGER PRIMARY KEY,
  slab_key INTEGER NOT NULL,
  station  INTEGER NOT NULL CHECK (station BETWEEN 1 AND 18),
  attempt  INTEGER NOT NULL CHECK (attempt BETWEEN 1 AND 255),
  bytes    BLOB NOT NULL,
  UNIQUE (slab_key, station, attempt)
) STRICT;
