-- SPDX-License-Identifier: Apache-2.0
--
-- The plant's database (PostgreSQL 15), schema version 1; `slabd-plant --init` makes it. docs/PLANT.md describes the
-- views, which are the contract for dashboards; the tables may change with the version.
--
--   inbox        what the lines have sent, one row for each row of their outbox; the only table that they write
--   line, epoch  who sent it: a line has a new epoch after its database was restored or begun again
--   slab, item, gauge, disposition, calibration, calibration_check, gauge_check, mould_reset, event: the rows of inbox
--                unfolded
--   trouble      rows of inbox that could not be unfolded, with the reason; plant.unfold_again() tries them again
--
-- A slab is named by the epoch in which it was first sent and its key in the line's database. Lengths in mm, angles in
-- degrees. Rights: slabd_plant_writer may send, slabd_plant_reader may read.

CREATE SCHEMA plant;

CREATE TABLE plant.version (
  one       boolean PRIMARY KEY DEFAULT true CHECK (one),
  version   integer NOT NULL,
  software  text NOT NULL,
  installed timestamptz NOT NULL DEFAULT now()
);

CREATE TABLE plant.line (
  line_id smallint GENERATED ALWAYS AS IDENTITY PRIMARY KEY,
  name    text NOT NULL UNIQUE,
  -- Newest epoch of the database that is the line's; a line says hello with it.
  current uuid,
  -- Role that sends for the line: no other one may.
  role    text
);

CREATE TABLE plant.epoch (
  epoch_id   integer GENERATED ALWAYS AS IDENTITY PRIMARY KEY,
  epoch      uuid NOT NULL UNIQUE,
  line_id    smallint NOT NULL REFERENCES plant.line,
  began      timestamptz NOT NULL,
  host       text NOT NULL,
  first_seen timestamptz NOT NULL DEFAULT now()
);

CREATE TABLE plant.inbox (
  epoch    uuid NOT NULL REFERENCES plant.epoch (epoch),
  seq      bigint NOT NULL CHECK (seq > 0),
  kind     text NOT NULL,
  sha256   bytea NOT NULL CHECK (length(sha256) = 32),
  doc      jsonb NOT NULL,
  received timestamptz NOT NULL DEFAULT now(),
  PRIMARY KEY (epoch, seq)
);
-- A slab's document that comes after the end of that slab was taken back must not bring it back.
CREATE INDEX inbox_reopened ON plant.inbox (((doc ->> 'slab_key')::bigint)) WHERE kind = 'reopened';

CREATE TABLE plant.trouble (
  epoch uuid NOT NULL,
  seq   bigint NOT NULL,
  why   text NOT NULL,
  at    timestamptz NOT NULL DEFAULT now(),
  PRIMARY KEY (epoch, seq)
);

CREATE TABLE plant.slab (
  epoch_id          integer NOT NULL REFERENCES plant.epoch,
  slab_key          bigint NOT NULL,
  seq               bigint NOT NULL,
  seq_epoch         uuid NOT NULL,
  slab_id           text NOT NULL,
  slab_no           bigint NOT NULL,
  slab_type         integer NOT NULL,
  mould             integer,
  began             timestamptz NOT NULL,
  ended             timestamptz NOT NULL,
  verdict           text NOT NULL,
  reason            integer NOT NULL,
  stations          smallint NOT NULL,
  stations_measured smallint NOT NULL,
  scans             integer NOT NULL,
  recipe            text NOT NULL,
  recipe_sha256     text NOT NULL,
  design_sha256     text NOT NULL,
  calibration_id    text NOT NULL,
  software          text NOT NULL,
  emulated          boolean NOT NULL,
  PRIMARY KEY (epoch_id, slab_key)
);
CREATE INDEX slab_by_time ON plant.slab (ended) INCLUDE (epoch_id, slab_key, verdict, slab_type, mould, slab_id);
CREATE INDEX slab_by_id ON plant.slab (slab_id, ended);
CREATE INDEX slab_not_passed ON plant.slab (ended) WHERE verdict <> 'pass';

CREATE TABLE plant.item_name (
  item_id smallint GENERATED ALWAYS AS IDENTITY PRIMARY KEY,
  name    text NOT NULL UNIQUE
);

CREATE TABLE plant.item (
  ended      timestamptz NOT NULL,
  epoch_id   integer NOT NULL,
  item_id    smallint NOT NULL,
  station    smallint NOT NULL,
  station_to smallint NOT NULL,
  slab_key   bigint NOT NULL,
  mould      integer,
  slab_type  integer NOT NULL,
  emulated   boolean NOT NULL,
  value      double precision,
  nominal    double precision,
  lower      double precision,
  upper      double precision,
  u          double precision,
  verdict    text NOT NULL
) PARTITION BY RANGE (ended);
-- Items of months without a partition: the clock was wrong, or the month was not made ahead.
CREATE TABLE plant.item_other PARTITION OF plant.item DEFAULT;
CREATE INDEX item_of_slab ON plant.item (epoch_id, slab_key);
CREATE INDEX item_by_time ON plant.item (item_id, ended)
  INCLUDE (epoch_id, value, nominal, lower, upper, mould, slab_type) WHERE NOT emulated;
CREATE INDEX item_not_passed ON plant.item (ended) INCLUDE (epoch_id, item_id, verdict, slab_key)
  WHERE verdict IN ('fail', 'indeterminate', 'not_measured') AND NOT emulated;
CREATE INDEX item_by_mould ON plant.item (mould, ended) INCLUDE (epoch_id, item_id, value, nominal, slab_type)
  WHERE mould IS NOT NULL AND NOT emulated;

-- Values of the gauges for a slab, usable or not, in the order of the line's configuration. u, u_master: k = 1.
CREATE TABLE plant.gauge (
  epoch_id        integer NOT NULL REFERENCES plant.epoch,
  slab_key        bigint NOT NULL,
  position        smallint NOT NULL,
  name            text NOT NULL,
  source          text NOT NULL,
  unit            text NOT NULL,
  state           text NOT NULL,
  value           double precision,
  u               double precision,
  u_master        double precision,
  arrived         timestamptz,
  checked         timestamptz,
  check_deviation double precision,
  PRIMARY KEY (epoch_id, slab_key, position)
);
CREATE INDEX gauge_by_name ON plant.gauge (name, epoch_id, slab_key);

CREATE TABLE plant.disposition (
  epoch_id  integer NOT NULL REFERENCES plant.epoch,
  slab_key  bigint NOT NULL,
  n         integer NOT NULL,
  at        timestamptz NOT NULL,
  who       text NOT NULL,
  decision  text NOT NULL,
  reason    text NOT NULL,
  authority text NOT NULL,
  second    text NOT NULL,
  PRIMARY KEY (epoch_id, slab_key, n)
);

CREATE TABLE plant.calibration (
  epoch_id       integer NOT NULL REFERENCES plant.epoch,
  seq            bigint NOT NULL,
  at             timestamptz NOT NULL,
  kind           text NOT NULL,
  slab_type      integer NOT NULL,
  is_rollback    boolean NOT NULL,
  calibration_id text NOT NULL,
  replaced_id    text NOT NULL,
  who            text NOT NULL,
  why            text NOT NULL,
  expires        timestamptz,
  PRIMARY KEY (epoch_id, seq)
);

CREATE TABLE plant.calibration_check (
  epoch_id          integer NOT NULL REFERENCES plant.epoch,
  seq               bigint NOT NULL,
  at                timestamptz NOT NULL,
  kind              text NOT NULL,
  reference_id      text NOT NULL,
  passed            boolean NOT NULL,
  slope_rad         double precision,
  jaw_distance_mm   double precision,
  off_x_mm          double precision,
  off_y_mm          double precision,
  off_z_mm          double precision,
  who               text NOT NULL,
  note              text NOT NULL,
  PRIMARY KEY (epoch_id, seq)
);

-- A gauge measured its master.
CREATE TABLE plant.gauge_check (
  epoch_id     integer NOT NULL REFERENCES plant.epoch,
  seq          bigint NOT NULL,
  at           timestamptz NOT NULL,
  name         text NOT NULL,
  unit         text NOT NULL,
  passed       boolean NOT NULL,
  value        double precision NOT NULL,
  master_value double precision NOT NULL,
  master_u     double precision NOT NULL,
  within       double precision NOT NULL,
  who          text NOT NULL,
  why          text NOT NULL,
  PRIMARY KEY (epoch_id, seq)
);

CREATE TABLE plant.mould_reset (
  epoch_id integer NOT NULL REFERENCES plant.epoch,
  seq      bigint NOT NULL,
  mould    integer NOT NULL,
  from_at  timestamptz NOT NULL,
  who      text NOT NULL,
  why      text NOT NULL,
  PRIMARY KEY (epoch_id, seq)
);

-- kind: started, fault, cleared; restored, begun_anew; reopened, remeasured (of a slab).
CREATE TABLE plant.event (
  epoch_id integer NOT NULL REFERENCES plant.epoch,
  seq      bigint NOT NULL,                -- of the outbox
  at       timestamptz NOT NULL,
  kind     text NOT NULL,
  code     integer NOT NULL,
  text     text NOT NULL,
  slab_key bigint,
  station  smallint,
  PRIMARY KEY (epoch_id, seq)
);
CREATE INDEX event_by_time ON plant.event (at);

-- ---- sending -------------------------------------------------------------------------------------------------------

CREATE FUNCTION plant.time_of(utime_us bigint) RETURNS timestamptz
  LANGUAGE sql IMMUTABLE PARALLEL SAFE AS
$$ SELECT timestamptz 'epoch' + utime_us * interval '1 microsecond' $$;

-- A line makes itself known: its name and all epochs of its database, oldest first. Returns why it is refused, or ''.
-- A database that does not know the newest epoch of the line is another one: a second line with this name, or a history
-- that was begun again without the old file; `take_over` says that it is the line's.
CREATE FUNCTION plant.hello(line_name text, epochs uuid[], began bigint[], host_name text, take_over boolean)
  RETURNS text LANGUAGE plpgsql SECURITY DEFINER SET search_path = pg_catalog, pg_temp AS
$$
DECLARE
  id smallint;
  newest record;
  other text;
BEGIN
  PERFORM pg_advisory_xact_lock(hashtext('slabd plant.hello'));
  SELECT l.name INTO other FROM plant.epoch e JOIN plant.line l USING (line_id)
    WHERE e.epoch = ANY (epochs) AND l.name <> line_name LIMIT 1;
  IF FOUND THEN
    RETURN format('this database has already sent as line %s: set [plant] line = "%s", or give it a history of its own '
                  '(slabctl db restore --fresh)', other, other);
  END IF;
  SELECT line_id INTO id FROM plant.line WHERE name = line_name;
  IF NOT FOUND THEN
    INSERT INTO plant.line (name) VALUES (line_name) RETURNING line_id INTO id;
  END IF;
  SELECT e.epoch, e.host, e.first_seen INTO newest FROM plant.epoch e JOIN plant.line l ON l.current = e.epoch
    WHERE l.line_id = id;
  IF FOUND AND NOT newest.epoch = ANY (epochs) AND NOT take_over THEN
    RETURN format('line %s has sent from another database since %s (epoch %s, computer %s), which this one does not '
                  'continue: give this line another name; or, if it replaces that one, as after a second restore of '
                  'the same backup, run slabd-plant --once --take-over',
                  line_name, newest.first_seen::timestamp(0), replace(newest.epoch::text, '-', ''), newest.host);
  END IF;
  IF EXISTS (SELECT 1 FROM plant.line l WHERE l.line_id = id AND l.role <> session_user) THEN
    RETURN (SELECT format('line %s sends as role %s, not %s: the owner of the plant''s database changes that with UPDATE '
                          'plant.line SET role = NULL WHERE name = %L', line_name, l.role, session_user, line_name)
            FROM plant.line l WHERE l.line_id = id);
  END IF;
  INSERT INTO plant.epoch (epoch, line_id, began, host)
    SELECT e, id, plant.time_of(b), host_name FROM unnest(epochs, began) WITH ORDINALITY AS given(e, b, place)
    ORDER BY place ON CONFLICT (epoch) DO NOTHING;
  UPDATE plant.line SET current = epochs[array_length(epochs, 1)], role = session_user WHERE line_id = id
    AND (current IS DISTINCT FROM epochs[array_length(epochs, 1)] OR role IS DISTINCT FROM session_user);
  RETURN '';
END
$$;

-- Slabs that these epochs have sent, whose end was not taken back, and that are not in plant.slab.
CREATE FUNCTION plant.missing_slabs(epochs uuid[]) RETURNS bigint
  LANGUAGE sql SECURITY DEFINER SET search_path = pg_catalog, pg_temp AS
$$
  SELECT count(DISTINCT (i.doc ->> 'slab_epoch', i.doc ->> 'slab_key')) FROM plant.inbox i
  WHERE i.epoch = ANY (epochs) AND i.kind = 'slab' AND i.doc ? 'verdict'
    AND NOT EXISTS (SELECT 1 FROM plant.slab s JOIN plant.epoch e USING (epoch_id)
                    WHERE e.epoch = (i.doc ->> 'slab_epoch')::uuid AND s.slab_key = (i.doc ->> 'slab_key')::bigint)
    AND NOT EXISTS (SELECT 1 FROM plant.inbox r WHERE r.kind = 'reopened'
                    AND (r.doc ->> 'slab_key')::bigint = (i.doc ->> 'slab_key')::bigint
                    AND r.epoch = ANY (epochs) AND (r.epoch <> i.epoch OR r.seq > i.seq))
    AND NOT EXISTS (SELECT 1 FROM plant.trouble t WHERE t.epoch = i.epoch AND t.seq = i.seq)
$$;

-- Makes the partition of a month, if that lies between 2020 and next year and is not there; before its first row.
CREATE FUNCTION plant.make_month(at timestamptz) RETURNS boolean
  LANGUAGE plpgsql SECURITY DEFINER SET search_path = pg_catalog, pg_temp SET timezone = 'UTC' AS
$$
DECLARE
  month date := date_trunc('month', at);
  name text := to_char(month, '"item_"YYYY_MM');
BEGIN
  IF month < date '2020-01-01' OR month > now() + interval '1 year' OR to_regclass('plant.' || name) IS NOT NULL THEN
    RETURN false;
  END IF;
  PERFORM pg_advisory_xact_lock(hashtext('slabd plant.make_month'));
  IF to_regclass('plant.' || name) IS NOT NULL THEN
    RETURN false;
  END IF;
  EXECUTE format('CREATE TABLE IF NOT EXISTS plant.%I PARTITION OF plant.item FOR VALUES FROM (%L) TO (%L)', name,
                 month, month + interval '1 month');
  EXECUTE format('GRANT SELECT ON plant.%I TO slabd_plant_reader', name);
  RETURN true;
EXCEPTION WHEN check_violation OR undefined_object OR duplicate_table OR unique_violation THEN
  RETURN false;  -- rows of this month are in item_other already, or another line makes it at this moment
END
$$;

-- A document has all decisions about its slab, as the line has them: after a restore it may lack some that were sent.
-- Without a list it was sent when the slab was no longer stored.
CREATE FUNCTION plant.unfold_decisions(of_epoch integer, key bigint, list jsonb) RETURNS void LANGUAGE sql AS
$$
  DELETE FROM plant.disposition WHERE epoch_id = of_epoch AND slab_key = key AND list IS NOT NULL;
  INSERT INTO plant.disposition (epoch_id, slab_key, n, at, who, decision, reason, authority, second)
    SELECT of_epoch, key, d.n, plant.time_of(d.utime_us), d.who, d.decision, d.reason, d.authority, d.second
    FROM jsonb_to_recordset(list) AS d(n integer, utime_us bigint, who text, decision text, reason text, authority text,
                                       second text)
$$;

CREATE FUNCTION plant.unfold_slab(row_epoch uuid, row_seq bigint, doc jsonb) RETURNS void LANGUAGE plpgsql AS
$$
DECLARE
  id integer;
  key bigint := (doc ->> 'slab_key')::bigint;
  before record;
  ended_at timestamptz := plant.time_of((doc ->> 'ended_utime_us')::bigint);
  of_mould integer := (doc ->> 'mould')::integer;
  of_type integer := (doc ->> 'slab_type')::integer;
BEGIN
  SELECT epoch_id INTO STRICT id FROM plant.epoch WHERE epoch = (doc ->> 'slab_epoch')::uuid;
  SELECT ended, seq, seq_epoch INTO before FROM plant.slab WHERE epoch_id = id AND slab_key = key;
  IF FOUND AND before.seq_epoch = row_epoch AND before.seq > row_seq THEN
    RETURN;
  END IF;
  IF EXISTS (SELECT 1 FROM plant.inbox i WHERE i.kind = 'reopened' AND (i.doc ->> 'slab_key')::bigint = key
             AND i.epoch = row_epoch AND i.seq > row_seq) THEN
    RETURN;
  END IF;
  IF before.ended IS NOT NULL THEN
    DELETE FROM plant.item WHERE epoch_id = id AND slab_key = key AND ended = before.ended;
    DELETE FROM plant.gauge WHERE epoch_id = id AND slab_key = key;
    DELETE FROM plant.slab WHERE epoch_id = id AND slab_key = key;
  END IF;
  INSERT INTO plant.slab (epoch_id, slab_key, seq, seq_epoch, slab_id, slab_no, slab_type, mould, began, ended, verdict,
                          reason, stations, stations_measured, scans, recipe, recipe_sha256, design_sha256,
                          calibration_id, software, emulated)
    VALUES (id, key, row_seq, row_epoch, doc ->> 'slab_id', (doc ->> 'slab_no')::bigint, of_type, of_mould,
            plant.time_of((doc ->> 'began_utime_us')::bigint), ended_at, doc ->> 'verdict', (doc ->> 'reason')::integer,
            (doc ->> 'stations')::smallint, (doc ->> 'stations_measured')::smallint, (doc ->> 'scans')::integer,
            doc ->> 'recipe', doc ->> 'recipe_sha256', doc ->> 'design_sha256', doc ->> 'calibration_id',
            doc ->> 'software', (doc ->> 'emulated')::boolean);
  INSERT INTO plant.item_name (name)
    SELECT DISTINCT i ->> 0 FROM jsonb_array_elements(doc -> 'items') AS i
    WHERE NOT EXISTS (SELECT 1 FROM plant.item_name n WHERE n.name = i ->> 0) ORDER BY 1 ON CONFLICT (name) DO NOTHING;
  INSERT INTO plant.item (ended, epoch_id, item_id, station, station_to, slab_key, mould, slab_type, emulated, value,
                          nominal, lower, upper, u, verdict)
    SELECT ended_at, id, n.item_id, (i ->> 1)::smallint, (i ->> 2)::smallint, key, of_mould, of_type,
           (doc ->> 'emulated')::boolean, (i ->> 4)::double precision, (i ->> 5)::double precision, (i ->> 6)::double precision,
           (i ->> 7)::double precision, (i ->> 8)::double precision, i ->> 3
    FROM jsonb_array_elements(doc -> 'items') AS i JOIN plant.item_name n ON n.name = i ->> 0;
  -- Without the list: sent by a version of slabd that knew no gauges.
  INSERT INTO plant.gauge (epoch_id, slab_key, position, name, source, unit, state, value, u, u_master, arrived,
                           checked, check_deviation)
    SELECT id, key, g.n, g.row ->> 'name', g.row ->> 'source', g.row ->> 'unit', g.row ->> 'state',
           (g.row ->> 'value')::double precision, (g.row ->> 'u')::double precision,
           (g.row ->> 'u_master')::double precision, plant.time_of((g.row ->> 'utime_us')::bigint),
           plant.time_of((g.row ->> 'check_utime_us')::bigint), (g.row ->> 'check_deviation')::double precision
    FROM jsonb_array_elements(coalesce(doc -> 'gauges', '[]')) WITH ORDINALITY AS g(row, n);
  PERFORM plant.unfold_decisions(id, key, doc -> 'dispositions');
END
$$;

CREATE FUNCTION plant.unfold_row(row_epoch uuid, row_seq bigint, row_kind text, doc jsonb) RETURNS void
  LANGUAGE plpgsql AS
$$
DECLARE
  id integer;
  of_slab integer;
  r jsonb := doc -> 'record';
  key bigint := (doc ->> 'slab_key')::bigint;
  at timestamptz := plant.time_of((doc ->> 'utime_us')::bigint);
BEGIN
  SELECT epoch_id INTO STRICT id FROM plant.epoch WHERE epoch = row_epoch;
  IF doc ->> 'slab_epoch' <> '' THEN
    SELECT epoch_id INTO STRICT of_slab FROM plant.epoch WHERE epoch = (doc ->> 'slab_epoch')::uuid;
  END IF;
  CASE row_kind
    WHEN 'slab' THEN
      -- Without content: the slab is no longer stored, or its end was taken back.
      IF doc ? 'verdict' THEN
        PERFORM plant.unfold_slab(row_epoch, row_seq, doc);
      END IF;
    WHEN 'decided' THEN
      PERFORM plant.unfold_decisions(of_slab, key, doc -> 'dispositions');
    WHEN 'reopened' THEN
      -- Sent before, in this epoch or in one before a restore.
      DELETE FROM plant.item i USING plant.slab s WHERE s.epoch_id = of_slab AND s.slab_key = key
        AND (s.seq_epoch <> row_epoch OR s.seq < row_seq) AND i.epoch_id = s.epoch_id AND i.slab_key = s.slab_key
        AND i.ended = s.ended;
      DELETE FROM plant.gauge g USING plant.slab s WHERE s.epoch_id = of_slab AND s.slab_key = key
        AND (s.seq_epoch <> row_epoch OR s.seq < row_seq) AND g.epoch_id = s.epoch_id AND g.slab_key = s.slab_key;
      DELETE FROM plant.slab s WHERE s.epoch_id = of_slab AND s.slab_key = key
        AND (s.seq_epoch <> row_epoch OR s.seq < row_seq);
      INSERT INTO plant.event VALUES (id, row_seq, at, row_kind, 0, '', key, NULL) ON CONFLICT DO NOTHING;
    WHEN 'remeasured' THEN
      INSERT INTO plant.event VALUES (id, row_seq, at, row_kind, 0, 'scan ' || (doc ->> 'attempt'), key,
                                      (doc ->> 'station')::smallint) ON CONFLICT DO NOTHING;
    WHEN 'care' THEN
      INSERT INTO plant.event VALUES (id, row_seq, at, r ->> 'kind', 0, concat_ws(': ', r ->> 'who', r ->> 'why'), NULL,
                                      NULL) ON CONFLICT DO NOTHING;
    WHEN 'event' THEN
      INSERT INTO plant.event VALUES (id, row_seq, at, r ->> 'kind', (r ->> 'code')::integer, r ->> 'text', NULL, NULL)
        ON CONFLICT DO NOTHING;
    WHEN 'applied' THEN
      INSERT INTO plant.calibration VALUES (id, (r ->> 'seq')::bigint, at, r ->> 'kind', (r ->> 'slab_type')::integer,
        (r ->> 'is_rollback')::integer = 1, r ->> 'calibration_id', r ->> 'replaced_id', r ->> 'who', r ->> 'why',
        plant.time_of((r ->> 'expires_utime_us')::bigint)) ON CONFLICT DO NOTHING;
    WHEN 'check' THEN
      INSERT INTO plant.calibration_check VALUES (id, (r ->> 'seq')::bigint, at, r ->> 'kind', r ->> 'reference_id',
        (r ->> 'passed')::integer = 1, (r ->> 'slope_rad')::double precision,
        (r ->> 'jaw_distance_mm')::double precision, (r ->> 'off_x_mm')::double precision,
        (r ->> 'off_y_mm')::double precision, (r ->> 'off_z_mm')::double precision, r ->> 'who', r ->> 'note')
        ON CONFLICT DO NOTHING;
    WHEN 'gauge_check' THEN
      INSERT INTO plant.gauge_check VALUES (id, (r ->> 'seq')::bigint, at, r ->> 'gauge', r ->> 'unit',
        (r ->> 'passed')::integer = 1, (r ->> 'value')::double precision, (r ->> 'master_value')::double precision,
        (r ->> 'master_u')::double precision, (r ->> 'within')::double precision, r ->> 'who', r ->> 'why')
        ON CONFLICT DO NOTHING;
    WHEN 'mould_reset' THEN
      INSERT INTO plant.mould_reset VALUES (id, (r ->> 'seq')::bigint, (r ->> 'mould')::integer,
        plant.time_of((r ->> 'from_utime_us')::bigint), r ->> 'who', r ->> 'why') ON CONFLICT DO NOTHING;
    ELSE
      RAISE EXCEPTION 'kind "%" is not known to this version of the plant''s database', row_kind;
  END CASE;
END
$$;

-- A document that cannot be unfolded is kept and noted: it must not hold up those behind it.
CREATE FUNCTION plant.unfold() RETURNS trigger
  LANGUAGE plpgsql SECURITY DEFINER SET search_path = pg_catalog, pg_temp AS
$$
BEGIN
  PERFORM plant.unfold_row(NEW.epoch, NEW.seq, NEW.kind, NEW.doc);
  RETURN NULL;
EXCEPTION
  WHEN OTHERS THEN
    -- The server's own troubles: the batch is repeated.
    IF left(SQLSTATE, 2) IN ('08', '25', '40', '53', '55', '57', '58', 'XX') THEN
      RAISE;
    END IF;
    INSERT INTO plant.trouble (epoch, seq, why) VALUES (NEW.epoch, NEW.seq, SQLERRM) ON CONFLICT DO NOTHING;
    RETURN NULL;
END
$$;
CREATE TRIGGER inbox_is_unfolded AFTER INSERT ON plant.inbox FOR EACH ROW EXECUTE FUNCTION plant.unfold();

-- A role sends for its own line only. The owner may, as for repairs.
CREATE FUNCTION plant.inbox_is_of_its_line() RETURNS trigger
  LANGUAGE plpgsql SECURITY DEFINER SET search_path = pg_catalog, pg_temp AS
$$
DECLARE
  of record;
BEGIN
  SELECT l.name, l.role INTO of FROM plant.epoch e JOIN plant.line l USING (line_id) WHERE e.epoch = NEW.epoch;
  IF of.role IS DISTINCT FROM session_user THEN
    RAISE EXCEPTION 'role % may not send for line %, which sends as %', session_user, of.name, of.role
      USING ERRCODE = 'insufficient_privilege';
  END IF;
  RETURN NEW;
END
$$;
CREATE TRIGGER inbox_is_of_its_line BEFORE INSERT ON plant.inbox
  FOR EACH ROW EXECUTE FUNCTION plant.inbox_is_of_its_line();

CREATE FUNCTION plant.inbox_stays() RETURNS trigger LANGUAGE plpgsql AS
$$ BEGIN RAISE EXCEPTION 'what a line has sent is never changed'; END $$;
CREATE TRIGGER inbox_stays BEFORE UPDATE ON plant.inbox FOR EACH ROW EXECUTE FUNCTION plant.inbox_stays();

-- Makes slab, item, gauge and the other tables again from inbox; returns the number of rows. Of the owner only.
CREATE FUNCTION plant.unfold_all() RETURNS bigint LANGUAGE plpgsql AS
$$
DECLARE
  t record;
  done bigint := 0;
BEGIN
  LOCK TABLE plant.inbox IN EXCLUSIVE MODE;
  TRUNCATE plant.item, plant.gauge, plant.slab, plant.disposition, plant.calibration, plant.calibration_check,
    plant.gauge_check, plant.mould_reset, plant.event, plant.trouble;
  FOR t IN SELECT i.* FROM plant.inbox i JOIN plant.epoch e USING (epoch) ORDER BY e.epoch_id, i.seq LOOP
    BEGIN
      PERFORM plant.unfold_row(t.epoch, t.seq, t.kind, t.doc);
    EXCEPTION WHEN OTHERS THEN
      INSERT INTO plant.trouble (epoch, seq, why) VALUES (t.epoch, t.seq, SQLERRM) ON CONFLICT DO NOTHING;
    END;
    done := done + 1;
  END LOOP;
  RETURN done;
END
$$;

-- Tries the documents of table trouble again, as after an upgrade; returns how many were unfolded. Of the owner only.
CREATE FUNCTION plant.unfold_again() RETURNS integer LANGUAGE plpgsql AS
$$
DECLARE
  t record;
  done integer := 0;
BEGIN
  FOR t IN SELECT i.* FROM plant.trouble JOIN plant.inbox i USING (epoch, seq) ORDER BY i.epoch, i.seq LOOP
    BEGIN
      PERFORM plant.unfold_row(t.epoch, t.seq, t.kind, t.doc);
      -- Later documents about the slab may have been unfolded already.
      IF t.doc ? 'dispositions' THEN
        PERFORM plant.unfold_decisions(s.epoch_id, (n.doc ->> 'slab_key')::bigint, n.doc -> 'dispositions')
          FROM (SELECT i.doc FROM plant.inbox i JOIN plant.epoch e USING (epoch)
                WHERE i.doc ->> 'slab_epoch' = t.doc ->> 'slab_epoch' AND i.doc ->> 'slab_key' = t.doc ->> 'slab_key'
                AND i.doc ? 'dispositions' ORDER BY e.epoch_id DESC, i.seq DESC LIMIT 1) AS n
          JOIN plant.epoch s ON s.epoch = (n.doc ->> 'slab_epoch')::uuid;
      END IF;
      DELETE FROM plant.trouble WHERE epoch = t.epoch AND seq = t.seq;
      done := done + 1;
    EXCEPTION WHEN OTHERS THEN
      UPDATE plant.trouble SET why = SQLERRM, at = now() WHERE epoch = t.epoch AND seq = t.seq;
    END;
  END LOOP;
  RETURN done;
END
$$;

-- ---- views: the contract -------------------------------------------------------------------------------------------

-- first: the first inspection of this SLAB_ID on any line that was not aborted; emulated slabs among themselves. The views
-- that count leave emulated slabs out.
CREATE VIEW plant.v_slab AS
  SELECT l.name AS line, s.slab_key, s.slab_id, s.slab_type, s.mould, s.ended, s.verdict, s.reason,
         (SELECT d.decision FROM plant.disposition d WHERE d.epoch_id = s.epoch_id AND d.slab_key = s.slab_key
          ORDER BY d.n DESC LIMIT 1) AS disposition,
         s.software, s.verdict <> 'aborted' AND (s.slab_id = '' OR NOT EXISTS (
           SELECT 1 FROM plant.slab b WHERE b.slab_id = s.slab_id AND b.verdict <> 'aborted'
           AND b.emulated = s.emulated AND (b.ended, b.epoch_id, b.slab_key) < (s.ended, s.epoch_id, s.slab_key))) AS first,
         s.began, s.stations, s.stations_measured, s.scans, s.recipe, s.recipe_sha256, s.design_sha256,
         s.calibration_id, s.emulated, e.epoch
  FROM plant.slab s JOIN plant.epoch e USING (epoch_id) JOIN plant.line l USING (line_id);

CREATE VIEW plant.v_item AS
  SELECT l.name AS line, i.slab_key, n.name AS item, i.station, i.station_to, i.value, i.nominal, i.lower, i.upper, i.u,
         i.verdict, i.ended, i.slab_type, i.mould, i.emulated, e.epoch
  FROM plant.item i JOIN plant.item_name n USING (item_id) JOIN plant.epoch e USING (epoch_id)
  JOIN plant.line l USING (line_id);

CREATE VIEW plant.v_gauge AS
  SELECT l.name AS line, g.slab_key, g.name AS gauge, g.unit, g.state, g.value, g.u, g.u_master, g.checked,
         g.check_deviation, s.ended, s.emulated, e.epoch
  FROM plant.gauge g JOIN plant.slab s USING (epoch_id, slab_key) JOIN plant.epoch e USING (epoch_id)
  JOIN plant.line l USING (line_id);

-- Days and months of the reader's time zone in which slabs ended. The views below look at each of them by itself, so
-- that a query for some days reads only what ended then: an index cannot be searched for ended::date, because that
-- depends on the time zone.
CREATE VIEW plant.day AS
  SELECT d::date AS day, d AS begins, d + interval '1 day' AS ends
  FROM (SELECT min(ended) AS first, max(ended) AS last FROM plant.slab) s,
       generate_series(date_trunc('day', s.first), s.last, interval '1 day') AS d;
CREATE VIEW plant.month AS
  SELECT m AS month, m + interval '1 month' AS ends
  FROM (SELECT min(ended) AS first, max(ended) AS last FROM plant.slab) s,
       generate_series(date_trunc('month', s.first), s.last, interval '1 month') AS m;

CREATE VIEW plant.v_first_pass_yield AS
  SELECT y.line, d.day, y.slab_type, y.slabs, y.passed, y.passed::double precision / y.slabs AS share
  FROM plant.day d CROSS JOIN LATERAL (
    SELECT s.line, s.slab_type, count(*) AS slabs, count(*) FILTER (WHERE s.verdict = 'pass') AS passed
    FROM plant.v_slab s WHERE s.ended >= d.begins AND s.ended < d.ends AND s.first AND NOT s.emulated
    GROUP BY s.line, s.slab_type) y;

CREATE VIEW plant.v_pareto AS
  SELECT p.line, d.day, p.item, p.failed, p.indeterminate, p.not_measured, p.slabs
  FROM plant.day d CROSS JOIN LATERAL (
    SELECT l.name AS line, n.name AS item, count(*) FILTER (WHERE i.verdict = 'fail') AS failed,
           count(*) FILTER (WHERE i.verdict = 'indeterminate') AS indeterminate,
           count(*) FILTER (WHERE i.verdict = 'not_measured') AS not_measured,
           count(DISTINCT (i.epoch_id, i.slab_key)) AS slabs
    FROM plant.item i JOIN plant.item_name n USING (item_id) JOIN plant.epoch e USING (epoch_id)
    JOIN plant.line l USING (line_id)
    WHERE i.ended >= d.begins AND i.ended < d.ends AND i.verdict IN ('fail', 'indeterminate', 'not_measured')
    AND NOT i.emulated GROUP BY l.name, n.name) p;

-- Deviations from the nominal by mould, item and month, over all lines.
CREATE VIEW plant.v_mould AS
  SELECT v.mould, v.slab_type, v.item, m.month, v.n, v.mean, v.sd, v.lines
  FROM plant.month m CROSS JOIN LATERAL (
    SELECT g.mould, g.slab_type, g.item, sum(g.n)::bigint AS n, sum(g.n * g.mean) / sum(g.n) AS mean,
           sqrt(greatest(0, sum(g.n * (g.variance + g.mean ^ 2)) - sum(g.n * g.mean) ^ 2 / sum(g.n))
                / nullif(sum(g.n) - 1, 0)) AS sd,
           count(DISTINCT e.line_id) AS lines
    -- First of each line's epoch: without a distinct count the values need not be sorted.
    FROM (SELECT i.mould, i.slab_type, n.name AS item, i.epoch_id, count(*)::double precision AS n,
                 avg(i.value - coalesce(i.nominal, 0)) AS mean, var_pop(i.value - coalesce(i.nominal, 0)) AS variance
          FROM plant.item i JOIN plant.item_name n USING (item_id)
          WHERE i.ended >= m.month AND i.ended < m.ends AND i.mould IS NOT NULL AND i.value IS NOT NULL
          AND NOT i.emulated GROUP BY i.mould, i.slab_type, n.name, i.epoch_id) g
    JOIN plant.epoch e USING (epoch_id) GROUP BY g.mould, g.slab_type, g.item) v;

-- One point of a control chart for each day, item and line.
CREATE VIEW plant.v_spc AS
  SELECT v.line, v.item, v.slab_type, d.day, v.n, v.mean, v.sd, v.low, v.high, v.lower, v.upper
  FROM plant.day d CROSS JOIN LATERAL (
    SELECT l.name AS line, n.name AS item, i.slab_type, count(i.value) AS n,
           avg(i.value - coalesce(i.nominal, 0)) AS mean, stddev_samp(i.value - coalesce(i.nominal, 0)) AS sd,
           min(i.value - coalesce(i.nominal, 0)) AS low, max(i.value - coalesce(i.nominal, 0)) AS high,
           min(i.lower - coalesce(i.nominal, 0)) AS lower, max(i.upper - coalesce(i.nominal, 0)) AS upper
    FROM plant.item i JOIN plant.item_name n USING (item_id) JOIN plant.epoch e USING (epoch_id)
    JOIN plant.line l USING (line_id)
    WHERE i.ended >= d.begins AND i.ended < d.ends AND i.value IS NOT NULL AND NOT i.emulated
    GROUP BY l.name, n.name, i.slab_type) v;

-- A fault of a line that has begun and not ended.
CREATE VIEW plant.v_open_fault AS
  SELECT l.name AS line, f.at AS since, f.code, f.text
  FROM plant.event f JOIN plant.epoch e USING (epoch_id) JOIN plant.line l USING (line_id)
  WHERE f.kind = 'fault' AND NOT EXISTS (
    SELECT 1 FROM plant.event g JOIN plant.epoch h USING (epoch_id) WHERE h.line_id = e.line_id
    AND (g.epoch_id > f.epoch_id OR g.epoch_id = f.epoch_id AND g.seq > f.seq)
    AND (g.kind = 'started' OR g.kind = 'cleared' AND g.code = f.code));

-- ---- rights --------------------------------------------------------------------------------------------------------

REVOKE ALL ON ALL FUNCTIONS IN SCHEMA plant FROM PUBLIC;
