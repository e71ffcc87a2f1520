-- SPDX-License-Identifier: Apache-2.0
-- Rights of the two roles, again at each `slabd-plant --init`.
GRANT USAGE ON SCHEMA plant TO slabd_plant_writer, slabd_plant_reader;
GRANT SELECT, INSERT ON plant.inbox TO slabd_plant_writer;
GRANT SELECT ON plant.version, plant.trouble, plant.epoch, plant.line TO slabd_plant_writer;
GRANT EXECUTE ON FUNCTION plant.hello(text, uuid[], bigint[], text, boolean), plant.make_month(timestamptz)
  TO slabd_plant_writer;
GRANT EXECUTE ON FUNCTION plant.missing_slabs(uuid[]) TO slabd_plant_writer;
GRANT SELECT ON ALL TABLES IN SCHEMA plant TO slabd_plant_reader;
GRANT EXECUTE ON FUNCTION plant.time_of(bigint) TO slabd_plant_writer, slabd_plant_reader;
-- Compiling the queries of the views takes longer than they do. Only the owner of the database may say so.
DO $$
BEGIN
  EXECUTE format('ALTER DATABASE %I SET jit = off', current_database());
EXCEPTION WHEN insufficient_privilege THEN
  RAISE NOTICE 'jit stays as it is: the database has another owner';
END
$$;
