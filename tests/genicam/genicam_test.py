#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""slabd-genicam against a GigE Vision device in software (camera_device.py) and slabd's end of the scan stream.
Usage: genicam_test.py BUILD_FOLDER [unittest's arguments]"""

import pathlib
import re
import shutil
import subprocess
import sys
import time
import unittest

import numpy as np

import camera_device
import peers

BUILD = None
WIDTH, HEIGHT = 240, 160
EXPOSURE_S = 20  # limit of an exposure, which takes less than a second on an idle machine
# Control of the device is lost or not got if this computer is busy for some seconds.
NO_CONTROL = "no camera answers|controlled by another|control of the camera was lost"


def repeated(ask, good):
    """The first good answer, or the tenth."""
    for turn in range(10):
        time.sleep(1 if turn else 0)
        answer = ask()
        if good(answer):
            break
    return answer


class Case(unittest.TestCase):
    def setUp(self):
        self.folder = peers.Folder()
        self.frames = self.folder.frames(4, WIDTH, HEIGHT)
        self.slabd = peers.Slabd()
        self.camera = self.gateway = None
        self.addCleanup(self.folder.held.cleanup)

    def tearDown(self):
        for process in (self.gateway, self.camera):
            if process:
                process.end()
        self.camera = self.gateway = None
        self.slabd.close()

    def again(self):
        """Ends everything, for another run in the same test."""
        self.tearDown()
        self.slabd = peers.Slabd()

    def device(self, *options):
        self.camera = peers.device(self.frames, *options)

    def program(self, config, *more):
        return peers.Process(pathlib.Path(BUILD) / "gateway/genicam/slabd-genicam", "--config", config, *more)

    def start(self, *options, **keys):
        """Device, gateway, and both connections."""
        self.device(*options)
        keys.setdefault("timeout_s", EXPOSURE_S)
        self.gateway = self.program(self.folder.config(self.slabd.port, **keys))
        self.slabd.connect()
        self.gateway.wait_for("camera slabd ")

    def check(self, *options, **keys):
        """Exit status and output of --check against a device with these options."""
        keys.setdefault("timeout_s", EXPOSURE_S)
        config = self.folder.config(self.slabd.port, **keys)

        def one():
            self.device(*options)  # a new one, which begins with the first frame
            ended = self.program(config, "--check", "--out", self.folder.path / "out.ply")
            ended.program.wait(peers.WAIT_S)
            status = ended.end()
            self.camera.end()
            return status, ended.text()

        return repeated(one, lambda ended: re.search(NO_CONTROL, ended[1]) is None)

    def points(self, number):
        return camera_device.read_ply(self.frames / f"{number:02}.ply")[2]

    def expect_scan(self, number):
        try:
            header, points = self.slabd.scan()
        except (OSError, EOFError) as why:
            self.fail(f"{why!r}\n{self.gateway.text()}\n{self.camera.text()}")
        self.assertEqual((header["session"], header["cmd_seq"]), (7, self.slabd.cmd_seq))
        self.assertEqual((header["width"], header["height"]), (WIDTH, HEIGHT))
        self.assertTrue(peers.same_points(points, self.points(number)), number)
        return header


    def expect_last_frame(self, scan):
        """The scan is the frame of the last trigger."""
        taken = int(re.findall(r"trigger (\d+)", self.camera.text())[-1])
        self.assertTrue(peers.same_points(scan[1], self.points(taken)), taken)


class Scans(Case):
    def scans(self, *options, count=3, **keys):
        self.start(*options, **keys)
        for number in range(1, count + 1):
            self.slabd.ask()
            self.expect_scan(number)

    def test_a_frame_arrives_bit_by_bit(self):
        self.scans()

    def test_a_planar_frame_arrives_bit_by_bit(self):
        self.scans("--formats", "Coord3D_ABC32f_Planar")

    def test_the_points_of_a_multi_part_frame_are_found_by_their_component(self):
        self.scans("--multipart", "--fault", "all_parts")

    def test_a_frame_with_chunk_data_arrives_bit_by_bit(self):
        self.scans("--chunks")

    def test_lost_packets_are_requested_again_up_to_20_percent(self):
        for loss, more in ((0.01, ()), (0.05, ("--multipart",)), (0.2, ()), (0.2, ("--multipart",))):
            with self.subTest(loss=loss, more=more):
                self.scans("--loss", loss, *more)
                self.again()

    def test_packets_out_of_order_and_twice_make_the_same_frame(self):
        self.scans("--reorder", "60", "--duplicate", "0.2")

    def test_jumbo_packets_are_used_as_configured(self):
        self.scans(packet_size=9000)

    def test_an_exposure_may_begin_with_acquisition_start(self):
        self.scans("--without", "TriggerSoftware,TriggerMode,TriggerSource,TriggerSelector", trigger="acquisition_start")

    def test_16_bit_points_have_the_node_maps_scale_offset_and_invalid_value(self):
        for name, invalid in (("Coord3D_ABC16", "0"), ("Coord3D_ABC16_Planar", "65535")):
            with self.subTest(name):
                status, text = self.check("--formats", name, "--invalid", invalid)
                self.assertEqual(status, 0, text)
                points = camera_device.read_ply(self.folder.path / "out.ply")[2]
                truth = self.points(1)
                self.assertTrue((np.isnan(points) == np.isnan(truth)).all())
                # Half a count of 0.01 mm, and the rounding to float32.
                self.assertLess(np.nanmax(np.abs(points.astype(float) - truth)), 0.0051)

    def test_a_test_device_can_be_marked(self):
        self.start(emulated=True)
        self.slabd.ask()
        self.assertEqual(self.expect_scan(1)["flags"], 1)


class Faults(Case):
    def refused(self, text, *options, status=None, **keys):
        code, out = self.check(*options, **keys)
        self.assertNotEqual(code, 0, out)
        if status is not None:
            self.assertEqual(code, status, out)
        self.assertRegex(out, text)
        self.assertFalse((self.folder.path / "out.ply").exists(), "nothing of a broken frame is written")

    def test_frames_that_are_not_complete_are_refused(self):
        for fault, text, more in (
                ("short", "355800 bytes arrived|bytes arrived, the frame has", ()),
                ("overlap", "never arrived", ("--multipart",)),
                ("no_frame", "no frame within", ()),
                ("forgets", "not complete", ("--loss", "0.05")),
                ("narrow", "239 x 160", ()),
                ("padding", "allowed padding is 0", ()),
                ("mono", "pixel format is 0x01080001", ()),
                ("payload_type", "payload type is none of", ()),
                ("chunk_size", "chunk data: the chunk before byte", ("--chunks",)),
                ("two_ranges", "component 4 twice", ("--multipart",)),
                ("no_range", "components 1, needed is 4", ("--multipart",))):
            with self.subTest(fault):
                self.refused(text, "--fault", fault, *more, timeout_s=2 if fault == "no_frame" else EXPOSURE_S)

    def test_lost_packets_without_resend_cost_the_scan(self):
        self.refused("not complete|bytes arrived", "--loss", "0.05", "--no-resend")

    def test_a_node_map_that_does_not_fit_is_refused_with_feature_and_allowed_values(self):
        for text, more, keys in (
                ("PixelFormat: the camera has Mono8, allowed are Coord3D_ABC32f", ("--formats", "Mono8"), {}),
                ("ComponentSelector: .* component is Depth, the camera has Intensity, Range, Confidence", (),
                 {"component": "Depth"}),
                ("Scan3dDistanceUnit: the camera does not state", ("--without", "Scan3dDistanceUnit"), {}),
                ("PayloadSize: found", ("--fault", "payload_size"), {}),
                ("TriggerSoftware: the camera does not have it", ("--without", "TriggerSoftware"), {}),
                ("Scan3dInvalidDataFlag: false", ("--formats", "Coord3D_ABC16"), {}),
                ("Scan3dCoordinateSelector: the camera does not have it",
                 ("--formats", "Coord3D_ABC16", "--without", "Scan3dCoordinateSelector"), {})):
            with self.subTest(text):
                self.refused(text, *more, status=3, **keys)

    def test_settings_that_can_be_corrected_are_corrected(self):
        status, text = self.check("--unit", "1", "--output-mode", "0", "--formats", "Mono8,Coord3D_ABC32f")
        self.assertEqual(status, 0, text)
        status, text = self.check("--without", "Scan3dDistanceUnit", unit_check="if_stated")
        self.assertEqual(status, 0, text)
        self.assertIn("does not state its unit", text)

    def test_an_error_ends_the_request_and_the_next_one_is_taken(self):
        self.start("--fault", "short")
        self.slabd.ask(timeout_ms=4000)
        self.gateway.wait_for("request 7-1, station 4: no scan: ")
        self.assertTrue(self.slabd.nothing(0.5), "nothing of a broken frame is sent")
        self.camera.tell("fault ")
        self.slabd.ask()
        self.expect_scan(2)

    def test_a_frame_of_an_exposure_that_was_given_up_is_never_the_next_ones(self):
        # This device sends the first frame with the second trigger; the camera's clock shows its age.
        self.start("--fault", "late")
        self.slabd.ask(timeout_ms=3000)
        self.gateway.wait_for("no scan: no frame within")
        self.slabd.ask()
        self.expect_scan(2)
        self.gateway.wait_for("1 frames of earlier exposures discarded")

    def test_without_a_clock_the_next_exposure_waits_for_the_one_before(self):
        # This device sends the first frame 5 s after its trigger, whatever happens in between.
        self.start("--fault", "slow", "--no-clock", timeout_s=10)
        self.slabd.ask(timeout_ms=2000)
        self.gateway.wait_for("no scan: no frame within")
        self.slabd.ask(timeout_ms=60_000)
        self.expect_scan(2)


class Link(Case):
    def test_a_slabd_that_accepts_refusals_gets_the_reason_at_once(self):
        self.start("--fault", "short")
        self.slabd.ask(extended=True)
        code, reason = self.slabd.refusal()
        self.assertEqual(code, 303)
        self.assertIn("bytes arrived, the frame has", reason)
        self.camera.tell("fault no_frame")
        self.slabd.ask(extended=True, timeout_ms=3000)
        self.assertEqual(self.slabd.refusal()[0], 302)

    def test_a_scan_carries_the_print_of_the_camera(self):
        self.start()
        self.slabd.ask()
        self.assertEqual(self.expect_scan(1)["reserved"], 0)
        self.slabd.ask(extended=True)
        identity = re.search(r"camera slabd (.*) at ", self.gateway.text())[1]
        print_of = 0xCBF29CE484222325
        for byte in identity.encode():
            print_of = (print_of ^ byte) * 0x100000001B3 % 2**64
        self.assertEqual(self.expect_scan(2)["reserved"], print_of)

    def test_a_cut_connection_is_continued_without_another_exposure(self):
        self.start()
        self.slabd.ask()
        self.slabd.receive(64 + 12 * 1000)
        self.slabd.link.close()
        self.slabd.connect()
        self.slabd.ask(have_points=1000, again=True)
        header, points = self.slabd.scan()
        self.assertEqual(header["first"], 1000)
        self.assertTrue(peers.same_points(points, self.points(1)[1000:]))
        self.assertEqual(self.camera.text().count("trigger"), 1)

    def test_a_restarted_gateway_takes_the_scan_again(self):
        self.start()
        self.slabd.ask()
        first = self.expect_scan(1)
        self.gateway.kill()
        self.gateway = self.program(self.folder.config(self.slabd.port, timeout_s=EXPOSURE_S))
        self.slabd.connect()
        self.slabd.ask(have_points=1000, again=True, timeout_ms=20_000)
        header = self.expect_scan(2)
        self.assertEqual(header["first"], 0)
        self.assertNotEqual(header["utime"], first["utime"])
        # The camera was controlled by the first run until its heartbeat timeout.
        self.assertIn("heartbeat timeout", self.camera.text())

    def test_a_device_that_dies_at_any_step_is_used_again(self):
        for step in ("start", "trigger", "leader", "half", "trailer"):
            with self.subTest(step):
                self.start("--die", step)
                self.slabd.ask(timeout_ms=5000)
                self.camera.wait_for(f"dies at {step}")
                self.camera.end()
                self.gateway.wait_for("request 7-1, station 4: no scan: ")
                self.assertTrue(self.slabd.nothing(0.2))
                self.camera = peers.device(self.frames)
                self.expect_last_frame(self.slabd.scan_of_one_of())
                self.again()

    def test_a_gateway_that_dies_at_any_step_is_replaced(self):
        self.start()
        for moment in (0.0, 0.005, 0.02, 0.05):
            self.slabd.ask(timeout_ms=5000)
            time.sleep(moment)
            self.gateway.kill()
            self.gateway.end()
            self.slabd.link.close()
            self.gateway = self.program(self.folder.config(self.slabd.port, timeout_s=EXPOSURE_S))
            self.slabd.connect()
            self.expect_last_frame(self.slabd.scan_of_one_of())

    def test_the_gateway_runs_before_camera_and_slabd(self):
        self.gateway = self.program(self.folder.config(self.slabd.port, timeout_s=EXPOSURE_S))
        self.slabd.connect()
        self.gateway.wait_for("no camera answers")
        self.slabd.ask(timeout_ms=60_000)
        self.camera = peers.device(self.frames)
        self.expect_scan(1)
        self.assertEqual(self.gateway.end(), 0)
        # SIGTERM releases the camera at once.
        self.gateway = self.program(self.folder.config(self.slabd.port, timeout_s=EXPOSURE_S))
        self.gateway.wait_for("camera slabd Test-Range")

    def test_malformed_lines_are_ignored(self):
        self.start()
        self.slabd.link.sendall(b'{"schema": "slabd.scan_request/1"}\n[]\nnot json\n{"schema": 5}\n'
                                b'{"schema": "slabd.scan_request/1", "session": 70000, "cmd_seq": 1}\n')
        self.slabd.ask()
        self.expect_scan(1)


class Identity(Case):
    def identity(self, *options):
        status, text = self.check(*options)
        self.assertEqual(status, 0, text)
        return re.search(r"^identity   (.*)$", text, re.MULTILINE)[1]

    def test_only_the_accepted_camera_firmware_and_settings_are_used(self):
        accepted = self.identity()
        self.assertRegex(accepted, r"^Test-Range T-0001 1\.13\.4 [0-9a-f]{8}$")
        self.assertEqual(self.identity(), accepted)
        others = [self.identity("--serial", "T-0002"), self.identity("--firmware", "1.14.0"),
                  self.identity("--formats", "Coord3D_ABC16", "--invalid", "0")]
        self.assertEqual(len({accepted, *others}), 4)
        self.start(accepted=accepted)
        self.slabd.ask()
        self.expect_scan(1)
        self.again()
        self.start("--firmware", "1.14.0", accepted=accepted)
        self.slabd.ask()
        self.gateway.wait_for(f'accepted is "{accepted}"')
        self.assertTrue(self.slabd.nothing(0.3))

    def test_another_setting_of_the_camera_is_another_identity(self):
        accepted = self.identity()
        self.device()
        done = repeated(lambda: subprocess.run([TOOL, "-a", peers.ADDRESS, "control", "ExposureTime=5000"], check=False,
                                               capture_output=True, text=True), lambda done: done.returncode == 0)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.gateway = self.program(self.folder.config(self.slabd.port, accepted=accepted))
        self.slabd.connect()
        self.slabd.ask(timeout_ms=20_000)
        self.gateway.wait_for(f'accepted is "{accepted}"')
        self.assertIn("verify this one", self.gateway.text())


TOOL = shutil.which("arv-tool-0.8")


class Device(Case):
    @unittest.skipIf(TOOL is None, "arv-tool is not installed (script/apt-packages-genicam)")
    def test_a_foreign_client_reads_the_device(self):
        self.device()
        features = ("DeviceModelName", "Width", "PixelFormat", "ComponentSelector=Range", "ComponentIDValue")
        texts = ("DeviceModelName = Test Range", f"Width = {WIDTH}", "PixelFormat = Coord3D_ABC32f",
                 "ComponentIDValue = 4")
        seen = repeated(lambda: subprocess.run([TOOL, "-a", peers.ADDRESS, "control", *features], capture_output=True,
                                               text=True, check=False),
                        lambda seen: all(text in seen.stdout for text in texts))
        for text in texts:
            self.assertIn(text, seen.stdout, seen.stderr)


if __name__ == "__main__":
    BUILD = sys.argv.pop(1)
    unittest.main(verbosity=2)
