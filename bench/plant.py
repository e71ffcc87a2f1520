#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""The tables of docs/PLANT.md: lines with a backlog sent at once, and years of a plant in one database.

  bench/plant.py BUILD drain [--lines 10] [--slabs 2000]     one day's backlog of several lines
  bench/plant.py BUILD years [--line-years 10]               sizes, and the example queries of docs/PLANT.md
  bench/plant.py BUILD cycle [--slabs 3] [--backlog 12000]   a line's slabs with and without a sender beside slabd

Needs script/apt-packages-postgres. The server has a folder of its own and the defaults of Debian.
"""
import argparse
import json
import pathlib
import re
import resource
import statistics
import subprocess
import sys
import tempfile
import threading
import time

SOURCE = pathlib.Path(__file__).resolve().parents[1]
sys.path.insert(0, str(SOURCE / "tests/plant"))
from emulated_line import line_settings, start_slabd, stop, store_settings  # noqa: E402
from server import Server  # noqa: E402

PLANT = """
[plant]
dsn = "{dsn}"
line = "hall-{number}"
"""


def peak_kb(pid):
    try:
        found = re.search(r"VmHWM:\s+(\d+)", pathlib.Path(f"/proc/{pid}/status").read_text())
        return int(found.group(1)) if found else 0
    except OSError:
        return 0


def drain(build, server, lines, slabs):
    with tempfile.TemporaryDirectory() as folder:
        configs = []
        for number in range(1, lines + 1):
            home = pathlib.Path(folder, str(number))
            home.mkdir()
            config = home / "slabd.toml"
            config.write_text(store_settings() + PLANT.format(dsn=server.dsn(), number=number))
            subprocess.run([build / "cli/slabctl", "simulate", "history", "--slabs", str(slabs), "--seed", str(number),
                            "--out", home / "slabd.db", "--recipe", SOURCE / "recipes/p5600.toml"], check=True,
                           stdout=subprocess.DEVNULL)
            configs.append(config)
        subprocess.run([build / "plant/slabd-plant", "--config", configs[0], "--init"], check=True,
                       stdout=subprocess.DEVNULL)
        peaks = []

        def send(config):
            process = subprocess.Popen([build / "plant/slabd-plant", "--config", config, "--once"],
                                       stderr=subprocess.DEVNULL)
            early, last, begun = 0, 0, time.monotonic()
            while process.poll() is None:
                last = peak_kb(process.pid) or last
                if not early and time.monotonic() - begun > 5:
                    early = last
                time.sleep(0.5)
            peaks.append((process.returncode, early or last, last))

        begun = time.monotonic()
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        threads = [threading.Thread(target=send, args=(config,)) for config in configs]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        took = time.monotonic() - begun
        used = resource.getrusage(resource.RUSAGE_CHILDREN)
        rows = int(server.one("SELECT count(*) FROM plant.inbox"))
        print(f"| Lines, slabs each | {lines}, {slabs} |")
        print(f"| Rows sent, all lines at once | {rows} in {took:.0f} s, {rows / took:.0f} a second |")
        cpu_s = used.ru_utime + used.ru_stime - before.ru_utime - before.ru_stime
        print(f"| Processor time of slabd-plant | {cpu_s / rows * 1e3:.1f} ms a row |")
        print(f"| Memory of one slabd-plant, after 5 s and at the end | {max(p[1] for p in peaks) / 1e3:.0f} MB, "
              f"{max(p[2] for p in peaks) / 1e3:.0f} MB |")
        print(f"| Size in the plant's database | "
              f"{int(server.one('SELECT pg_database_size(current_database())')) / 1e6:.0f} MB |")
        assert all(p[0] == 0 for p in peaks) and rows == lines * slabs


YEAR_SLABS = 43_500
# As many items as a P5600 has, about their nominals; one in 400 does not pass.
LOAD = """
INSERT INTO plant.slab SELECT {epoch}, k, k, '{uuid}', 'Y{epoch}-' || k, k, 5600, 1 + k % 60, t - interval '5 min', t,
  CASE WHEN k % 33 = 0 THEN 'fail' ELSE 'pass' END, 0, 18, 18, 18, 'p5600', '', '', 'he-1', 'slabd', false
  FROM (SELECT k, timestamptz '{begin}' + k * interval '12 min 5 s' AS t FROM generate_series(1, {slabs}) k) s;
INSERT INTO plant.item SELECT t, {epoch}, 1 + n % {names}, 1 + n % 18, 0, k, 1 + k % 60, 5600, false,
  10 + 0.1 * random() + 0.02 * (k % 60), 10.5, 9.5, 12.5, 0.05,
  CASE WHEN (k * 280 + n) % 400 <> 0 THEN 'pass' WHEN n % 3 = 0 THEN 'indeterminate' ELSE 'fail' END
  FROM (SELECT k, timestamptz '{begin}' + k * interval '12 min 5 s' AS t FROM generate_series(1, {slabs}) k) s,
  generate_series(1, 280) n;
"""


def examples():
    """The queries of docs/PLANT.md with their headings."""
    text = (SOURCE / "docs/PLANT.md").read_text()
    found = re.findall(r"^    -- (.*)\n((?:    .*\n)+?)(?=\n|    -- )", text, re.M)
    return [(title, " ".join(line.strip() for line in sql.splitlines())) for title, sql in found]


def years(build, server, line_years):
    with tempfile.TemporaryDirectory() as folder:
        config = pathlib.Path(folder, "slabd.toml")
        config.write_text(store_settings() + PLANT.format(dsn=server.dsn(), number=1))
        subprocess.run([build / "plant/slabd-plant", "--config", config, "--init"], check=True,
                       stdout=subprocess.DEVNULL)
    names = ["seat_slope", "seat_flatness", "jaw_distance", "casing_spacing", "jaw_angle_inner", "jaw_angle_outer",
             "seat_lateral", "seat_vertical", "casing_protrusion_inner", "casing_protrusion_outer", "surface_pores",
             "block_damage", "seat_spacing", "warp"]
    server.run("INSERT INTO plant.item_name (name) VALUES " + ", ".join(f"('{name}')" for name in names))
    begun = time.monotonic()
    begin = time.strftime("%Y-%m-%d", time.gmtime(time.time() - 365 * 86400))
    for month in range(-1, 14):
        server.run(f"SELECT plant.make_month(timestamptz '{begin}' + {month} * interval '1 month')")
    # Rows one by one into the indexes take eight minutes a line-year; the indexes are made of all rows afterwards.
    for setting in ("max_wal_size = '4GB'", "maintenance_work_mem = '512MB'"):
        server.run(f"ALTER SYSTEM SET {setting}")
    server.run("SELECT pg_reload_conf()")
    indexes = server.run("SELECT indexname, indexdef FROM pg_indexes WHERE schemaname = 'plant' AND tablename = 'item'")
    for name, _ in indexes:
        server.run(f"DROP INDEX plant.{name}")
    for number in range(1, line_years + 1):
        uuid = f"{number:032x}"
        why = server.one(f"SELECT plant.hello('hall-{number}', '{{{uuid}}}', '{{1}}', 'bench', false)")
        assert not why, why
        server.run(LOAD.format(epoch=number, uuid=uuid, begin=begin, slabs=YEAR_SLABS, names=len(names)))
    for _, definition in indexes:
        server.run(definition.replace(" ON ONLY ", " ON "))
    server.run("VACUUM ANALYZE plant.slab")
    server.run("VACUUM ANALYZE plant.item")
    print(f"| Line-years, slabs, items | {line_years}, {server.one('SELECT count(*) FROM plant.slab')}, "
          f"{line_years * YEAR_SLABS * 280} |")
    print(f"| Loaded by SQL in | {time.monotonic() - begun:.0f} s |")
    print(f"| Size | {int(server.one('SELECT pg_database_size(current_database())')) / 1e9:.1f} GB |")
    for title, sql in examples():
        sql = sql.replace("C3-0417-M012", "Y1-4321")
        times = []
        for _ in range(3):
            begun = time.monotonic()
            server.run(sql.rstrip(";"))
            times.append(time.monotonic() - begun)
        print(f"| {title} | {min(times[1:]):.2f} s, the first time {times[0]:.2f} s |")


def cycle(build, server, slabs, backlog, points):
    """Slabs by turns without and with slabd-plant, which sends a backlog meanwhile, on one computer."""
    seen = {"no sender": [], "slabd-plant sends a backlog": []}
    with tempfile.TemporaryDirectory() as folder:
        home = pathlib.Path(folder)
        config = home / "slabd.toml"
        config.write_text(line_settings() + PLANT.format(dsn=server.dsn(), number=1))
        subprocess.run([build / "cli/slabctl", "simulate", "history", "--slabs", str(backlog), "--out", home / "slabd.db",
                        "--recipe", SOURCE / "recipes/p5600.toml"], check=True, stdout=subprocess.DEVNULL)
        subprocess.run([build / "plant/slabd-plant", "--config", config, "--init"], check=True, stdout=subprocess.DEVNULL)
        slabd = start_slabd(build, config, home / "log")
        try:
            # One slab before, so that every file and cache is there.
            for turn in range(1 + 2 * slabs):
                title = list(seen)[turn % 2 == 0 and turn > 0]
                sender = None
                if title != "no sender":
                    sender = subprocess.Popen([build / "plant/slabd-plant", "--config", config], stderr=subprocess.DEVNULL)
                before = int(server.one("SELECT count(*) FROM plant.inbox"))
                ended = subprocess.run([build / "cli/slabctl", "simulate", "--config", config, "--points", points,
                                        "--slab-no", str(turn + 1), "--slab-id", f"CYCLE-{turn}", "--json"],
                                       capture_output=True, text=True, check=False)
                sent = int(server.one("SELECT count(*) FROM plant.inbox")) - before
                if sender is not None:
                    stop(sender)
                slab = json.loads(ended.stdout)["slabs"][0]
                if slab["last_acquired_to_verdict_s"] is None:
                    sys.exit(f"slab {turn + 1} has no verdict: {slab['trouble']}\n{(home / 'log').read_text()[-2000:]}")
                blocks = [1e3 * one["acquired_to_result_s"] for one in slab["stations"]
                          if one["acquired_to_result_s"] is not None]
                if turn > 0:
                    seen[title].append((1e3 * slab["last_acquired_to_verdict_s"], blocks, sent))
        finally:
            stop(slabd)
    print("| Beside slabd | Slabs | Rows sent a slab | Verdict after the last ACQUIRED, median | longest "
          "| Block, median | longest |")
    print("|---|---|---|---|---|---|---|")
    for title, rows in seen.items():
        waits = [wait for wait, _, _ in rows]
        blocks = [block for _, some, _ in rows for block in some]
        print(f"| {title} | {len(rows)} | {statistics.mean(sent for _, _, sent in rows):.0f} | {statistics.median(waits):.0f} ms "
              f"| {max(waits):.0f} ms | {statistics.median(blocks):.0f} ms | {max(blocks):.0f} ms |")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("build", type=pathlib.Path)
    parser.add_argument("what", choices=("drain", "years", "cycle"))
    parser.add_argument("--lines", type=int, default=10)
    parser.add_argument("--slabs", type=int, default=0, help="default: 2000 of each line, 3 of a cycle")
    parser.add_argument("--backlog", type=int, default=12_000)
    parser.add_argument("--points", choices=("full", "quarter"), default="full")
    parser.add_argument("--line-years", type=int, default=10)
    options = parser.parse_args()
    server = Server()
    try:
        if options.what == "drain":
            drain(options.build.resolve(), server, options.lines, options.slabs or 2000)
        elif options.what == "cycle":
            cycle(options.build.resolve(), server, options.slabs or 3, options.backlog, options.points)
        else:
            years(options.build.resolve(), server, options.line_years)
    finally:
        server.close()


if __name__ == "__main__":
    main()
