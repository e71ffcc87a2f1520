-- SPDX-License-Identifier: Apache-2.0
--
-- From schema version 6 to 7: what a verdict can be proven with again, the checksum of each scan's points and the files of
-- the recipes. The columns are explained in schema.sql.

ALTER TABLE attempt ADD COLUMN points_crc32c INTEGER CHECK (points_crc32c BETWEEN 0 AND 4294967295);

CREATE TABLE recipe_text (
  sha256        TEXT PRIMARY KEY,
  name          TEXT NOT NULL,
  text          TEXT NOT NULL,
  kept_utime_us INTEGER NOT NULL
) STRICT;
CREATE TRIGGER recipe_text_stays BEFORE UPDATE ON recipe_text
  BEGIN SELECT RAISE(ABORT, 'a recipe that was used is never changed'); END;
CREATE TRIGGER recipe_text_is_kept BEFORE DELETE ON recipe_text
  BEGIN SELECT RAISE(ABORT, 'a recipe that was used is never deleted'); END;
