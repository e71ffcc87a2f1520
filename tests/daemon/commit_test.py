#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""Output of script/commit for a tree, in scratch trees with a copy of it."""
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import unittest

SOURCE = pathlib.Path(__file__).resolve().parents[2]


class Commit(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.addCleanup(self.folder.cleanup)
        self.tree = pathlib.Path(self.folder.name, "tree").resolve()
        (self.tree / "script").mkdir(parents=True)
        shutil.copy(SOURCE / "script/commit", self.tree / "script/commit")
        # Without user settings, and without a tree above that a variable of the environment refers to.
        self.environment = {k: v for k, v in os.environ.items() if not k.startswith("GIT_") and k != "SLABD_COMMIT"}
        self.environment.update(HOME=self.folder.name, GIT_CONFIG_NOSYSTEM="1")

    def git(self, *arguments, tree=None):
        return subprocess.run(["git", "-C", tree or self.tree, "-c", "user.name=a", "-c", "user.email=a@example.org", *arguments],
                              check=True, env=self.environment, capture_output=True, text=True).stdout.strip()

    def make_repository(self):
        self.git("init", "--quiet")
        self.git("add", ".")
        self.git("commit", "--quiet", "--message", "first")

    def say(self, *arguments, **environment):
        return subprocess.run([self.tree / "script/commit", *arguments], env={**self.environment, **environment},
                              capture_output=True, text=True)

    def said(self, **environment):
        ended = self.say(**environment)
        self.assertEqual(ended.returncode, 0, ended.stderr)
        return ended.stdout.strip()

    def test_a_tree_without_git_is_unknown(self):
        self.assertEqual(self.said(), "unknown")

    def test_a_tarball_inside_of_another_project_is_not_of_its_commit(self):
        above = pathlib.Path(self.folder.name).resolve()
        self.git("init", "--quiet", tree=above)
        self.git("add", ".", tree=above)
        self.git("commit", "--quiet", "--message", "theirs", tree=above)
        self.assertEqual(self.said(), "unknown")

    def test_a_repository_without_a_commit_is_unknown(self):
        self.git("init", "--quiet")
        self.assertEqual(self.said(), "unknown")

    def test_a_commit_is_named_and_a_changed_file_is_said(self):
        self.make_repository()
        clean = self.said()
        self.assertRegex(clean, r"^g[0-9a-f]{7,}$")
        self.assertTrue(self.git("rev-parse", "HEAD").startswith(clean[1:]))
        (self.tree / "note").write_text("not known to git")
        self.assertEqual(self.said(), clean)
        with open(self.tree / "script/commit", "a") as script:
            script.write("# changed\n")
        self.assertEqual(self.said(), clean + ".dirty")
        self.git("add", ".")
        self.assertEqual(self.said(), clean + ".dirty", "staged is not committed")
        self.git("commit", "--quiet", "--message", "second")
        self.assertRegex(self.said(), r"^g[0-9a-f]{7,}$")
        self.assertNotEqual(self.said(), clean)

    def test_a_worktree_has_a_commit_of_its_own(self):
        self.make_repository()
        other = pathlib.Path(self.folder.name).resolve() / "other"
        self.git("worktree", "add", "--quiet", "-b", "other", str(other))
        self.git("commit", "--quiet", "--allow-empty", "--message", "there", tree=other)
        there = subprocess.run([other / "script/commit"], env=self.environment, capture_output=True, text=True).stdout.strip()
        self.assertRegex(there, r"^g[0-9a-f]{7,}$")
        self.assertNotEqual(there, self.said())

    def test_what_is_given_counts_unless_it_cannot_be_a_version(self):
        self.make_repository()
        self.assertEqual(self.said(SLABD_COMMIT="g0123abc"), "g0123abc")
        self.assertRegex(self.said(SLABD_COMMIT=""), r"^g[0-9a-f]{7,}$")
        for bad in ('g"; }', "a b", "x" * 41):
            self.assertEqual(self.say(SLABD_COMMIT=bad).returncode, 2, bad)

    def test_the_source_is_written_only_when_it_says_something_else(self):
        self.make_repository()
        source = self.tree / "build/commit.cpp"
        self.assertEqual(self.say("--into", source).returncode, 0)
        self.assertIn('return "%s";' % self.said(), source.read_text())
        os.utime(source, (1, 1))
        self.assertEqual(self.say("--into", source).returncode, 0)
        self.assertEqual(source.stat().st_mtime, 1)
        self.assertEqual(self.say("--into", source, SLABD_COMMIT="other").returncode, 0)
        self.assertNotEqual(source.stat().st_mtime, 1)
        self.assertIn('return "other";', source.read_text())

    def test_wrong_use_is_said(self):
        self.assertEqual(self.say("--in").returncode, 2)
        self.assertEqual(self.say("--into").returncode, 2)
        self.assertTrue(re.search("script/commit --into FILE", self.say("--help").stdout))


if __name__ == "__main__":
    sys.exit(unittest.main())
