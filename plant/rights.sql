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
