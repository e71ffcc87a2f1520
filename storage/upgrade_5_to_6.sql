-- SPDX-License-Identifier: Apache-2.0
--
-- From schema version 5 to 6: the last scans are known again after a restart. The columns are explained in schema.sql.

CREATE TABLE seen_scan (
  id          INTEGER PRIMARY KEY,
  fingerprint INTEGER NOT NULL UNIQUE
) STRICT;
