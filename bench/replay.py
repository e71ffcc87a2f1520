#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The table of docs/REPLAY.md: stored slabs measured again by one worker and by two, in one run.

  bench/replay.py BUILD [--slabs 6] [--points full]

An emulated line stores the slabs. The workers are processes of one computer, and tasks of a Slurm of two nodes on it,
one of them drained for one worker (script/apt-packages-slurm; without it these rows are left out).
"""
import argparse
import os
import pathlib
import subprocess
import sys
import tempfile
import time

from emulated_line import line_settings, start_slabd, stop

SOURCE = pathlib.Path(__file__).resolve().parents[1]
CLUSTER = SOURCE / "tests/cli/slurm_cluster"


def store_slabs(build, home, slabs, points):
    config = home / "slabd.toml"
    config.write_text(line_settings())
    slabd = start_slabd(build, config, home / "log")
    try:
        for number in range(1, slabs + 1):
            ended = subprocess.run([build / "cli/slabctl", "simulate", "--config", config, "--points", points,
                                    "--slab-no", str(number), "--slab-id", f"AGAIN-{number}"],
                                   capture_output=True, text=True, check=False)
            if ended.returncode not in (0, 1):
                sys.exit(f"{ended.stderr}\n{(home / 'log').read_text()[-2000:]}")
    finally:
        stop(slabd)
    return config


def timed(command, **how):
    begun = time.monotonic()
    ended = subprocess.run(command, capture_output=True, text=True, check=False, **how)
    if ended.returncode != 0:
        sys.exit(f"{command}: status {ended.returncode}\n{ended.stdout}{ended.stderr}")
    return time.monotonic() - begun


def merged(build, folder):
    return subprocess.run([build / "cli/slabctl", "replay", "--merge", folder, "--json"], capture_output=True, text=True,
                          check=True).stdout


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("build", type=pathlib.Path)
    parser.add_argument("--slabs", type=int, default=6)
    parser.add_argument("--points", choices=("full", "quarter"), default="full")
    options = parser.parse_args()
    build = options.build.resolve()
    with tempfile.TemporaryDirectory(prefix="slabd-replay-") as folder:
        home = pathlib.Path(folder)
        home.chmod(0o755)
        config = store_slabs(build, home, options.slabs, options.points)
        replay = [build / "cli/slabctl", "replay", "--all", "--verify", "--config", config]
        rows, results = [], []
        timed([*replay, "--out", home / "first", "--shard", "1/1"])  # the scans are in the page cache afterwards
        for workers in (1, 2):
            out = home / f"processes-{workers}"
            script = (f"seq 1 {options.slabs} | xargs -P {workers} -I{{}} {' '.join(map(str, replay))} "
                      f"--shard {{}}/{options.slabs} --out {out}")
            rows.append((f"{workers} process{'es' if workers > 1 else ''} (xargs)", timed(["sh", "-c", script])))
            results.append(merged(build, out))
        cluster = home / "cluster"
        if subprocess.run([CLUSTER, cluster, "check"], check=False).returncode == 0:
            environment = dict(os.environ, SLURM_CONF=str(cluster / "slurm.conf"))
            subprocess.run([CLUSTER, cluster, "start"], check=True)
            try:
                for workers in (1, 2):
                    out = home / f"slurm-{workers}"
                    job = home / f"job-{workers}.sh"
                    job.write_text(subprocess.run([*replay, "--slurm", str(options.slabs), "--out", out], check=True,
                                                  capture_output=True, text=True).stdout)
                    state = "state=drain reason=bench" if workers == 1 else "state=resume"
                    subprocess.run(f"scontrol update nodename=node2 {state}", shell=True, check=True, env=environment)
                    # sbatch --wait looks at ever longer intervals.
                    script = (f"sbatch --parsable --output={cluster}/%a.out {job} && "
                              "while [ -n \"$(squeue --noheader)\" ]; do sleep 0.2; done")
                    rows.append((f"{workers} node{'s' if workers > 1 else ''} (Slurm)",
                                 timed(["sh", "-c", script], env=environment)))
                    results.append(merged(build, out))
            finally:
                subprocess.run([CLUSTER, cluster, "stop"], check=False)
        if len(set(results)) != 1:
            sys.exit("the merged results differ")
    print("| Workers | Slabs | Time | Slabs an hour | Speed to one |")
    print("|---|---|---|---|---|")
    for i, (name, took) in enumerate(rows):
        print(f"| {name} | {options.slabs} | {took:.1f} s | {3600 * options.slabs / took:.0f} | "
              f"{rows[i - i % 2][1] / took:.2f} |")
    print("\nThe merged results are the same, byte for byte.")


if __name__ == "__main__":
    main()
