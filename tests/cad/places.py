# SPDX-License-Identifier: Apache-2.0
"""Programs, recipes and runs that the tests of CAD files share."""

import os
import pathlib
import subprocess
import tempfile

SOURCE = pathlib.Path(__file__).resolve().parents[2]
RECIPE = SOURCE / "recipes" / "p5600.toml"


class Programs:
    def __init__(self, build):
        self.slabctl = pathlib.Path(build) / "cli" / "slabctl"
        self.cad = pathlib.Path(build) / "cad" / "slabd-cad"
        self.folder = tempfile.TemporaryDirectory(prefix="slabd-cad-")

    def path(self, name):
        return str(pathlib.Path(self.folder.name) / name)

    def run(self, *arguments, cad=None, timeout=300):
        environment = dict(os.environ, SLABD_CAD=str(cad or self.cad), LC_ALL="C")
        return subprocess.run([self.slabctl, *map(str, arguments)], capture_output=True, text=True,
                              env=environment, timeout=timeout)

    def export(self, name, *more, recipe=RECIPE):
        ended = self.run("export", "model", recipe, "--out", self.path(name), *more)
        if ended.returncode != 0:
            raise AssertionError(f"export {name}: status {ended.returncode}: {ended.stderr}")
        return self.path(name)
