#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""The function blocks of docs/plc alone, cycle by cycle, on a clock of the test's own: what they write when an order is
given up and when the line comes back from hand. Whole slabs with them are plc_peers_test's."""

import os
import unittest

from scl_block import siemens
from siemens_test import crc16
from st_block import Block

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
SYNC, CONTROL, CMD_SEQ = 3, 1, 39
SESSION, ACK, STATUS, ACQ, REFUSED, REFUSE_CODE, REFUSE_SEQ = 9, 10, 11, 12, 21, 26, 27


def structured_text(clock):
    return Block(os.path.join(ROOT, "docs/plc/FB_SLABD.st"), clock=clock)


def scl(clock):
    return siemens(clock).instance("FB_SLABD")


class Line:
    """slabd as registers: what the block reads, set by hand."""

    def __init__(self, make):
        self.now = 100.0
        self.block = make(lambda: self.now)
        self.ir = [0] * 110
        self.ir[0:4] = [0x534C, 0x0101, 0x1234, 0x5678]
        self.ir[5] = 0b1000000001  # READY, PLC_LINK_OK
        self.ir[SESSION] = 7
        self.ir[ACK] = 41
        self.inputs = {"xEnable": True, "uiSyncLast": 5}

    def cycle(self, seconds=0.01, **inputs):
        self.now += seconds
        self.inputs.update(inputs)
        self.block(IR=list(self.ir), xLinkOk=True, **self.inputs)
        return self.block

    def started(self):
        self.cycle()
        self.ir[SESSION] += 1
        block = self.cycle()
        assert block.xReady
        return block

    def order(self):
        """A SCAN whose block is written and not answered."""
        block = self.started()
        self.cycle(xExecute=True, uiCmd=2, uiStation=1)
        written = block.xWriteCommand
        self.cycle()
        assert written or block.xWriteCommand
        return block


class Cases:
    make = None

    def line(self):
        return Line(type(self).make)

    def test_after_its_start_it_asks_for_one_session(self):
        line = self.line()
        line.cycle()
        self.assertEqual(line.block.HR[SYNC], 6)
        self.assertFalse(line.block.xReady)
        for _ in range(5):
            line.cycle()
        self.assertEqual(line.block.HR[SYNC], 6)
        self.assertFalse(line.block.xReady)
        line.ir[SESSION] += 1
        self.assertTrue(line.cycle().xReady)

    def test_a_map_is_known_by_the_high_byte_of_its_version(self):
        line = self.line()
        line.started()
        for version, wrong in ((0x0100, False), (0x0101, False), (0x01FF, False), (0x0001, True), (0x0200, True)):
            line.ir[1] = version
            self.assertEqual(line.cycle().xWrongMap, wrong, hex(version))

    def test_what_is_known_of_the_slab_is_part_of_the_order(self):
        line = self.line()
        block = line.started()
        line.cycle(xExecute=True, uiCmd=1, uiMould=12, uiSlabTemperature=2931, uiSlabAge=72)
        line.cycle(uiMould=13, uiSlabTemperature=0, uiSlabAge=73)
        self.assertEqual(block.HR[32:37], [2931, 72, 12, 0, 0], "as it was when the order began")

    def test_the_checksum_of_the_second_chip_is_part_of_the_order(self):
        for text in ("C3-0001-M012", "S", "ABCDEFGHIJKLMNOPQRSTUVWXYZ012345"):
            octets = text.encode("ascii").ljust(32, b"\0")
            words = [octets[i] << 8 | octets[i + 1] for i in range(0, 32, 2)]
            line = self.line()
            block = line.started()
            line.cycle(xExecute=True, uiCmd=1, awSecondId=words)
            line.cycle(awSecondId=[0] * 16)
            self.assertEqual(block.HR[35], crc16(words), text)

    def test_an_order_without_an_answer_is_made_void(self):
        line = self.line()
        block = line.order()
        rewrites = 0
        for _ in range(300):
            if line.cycle().xError:
                break
            rewrites += block.xWriteCommand
        self.assertTrue(block.xError)
        self.assertEqual(rewrites, 3)
        line.cycle()
        self.assertEqual(block.HR[SYNC], 7, "a block still on its way carries the old session")
        self.assertTrue(block.xWriteControl)
        line.cycle(xExecute=False)
        line.cycle()
        self.assertFalse(block.xReady, "not before the new session is there")
        line.ir[SESSION] += 1
        line.cycle()
        self.assertTrue(line.cycle().xReady)

    def test_an_order_that_was_answered_needs_no_new_session(self):
        line = self.line()
        block = line.order()
        line.ir[ACK], line.ir[STATUS] = 42, 0x8000 + 202
        for _ in range(5):
            line.cycle()
        self.assertTrue(block.xError)
        self.assertEqual(block.uiCode, 202)
        self.assertEqual(block.HR[SYNC], 6)

    def test_a_line_taken_in_hand_gives_up_what_was_not_accepted(self):
        line = self.line()
        block = line.order()
        line.cycle(xEnable=False)
        self.assertTrue(block.xError)
        self.assertEqual(block.uiCode, 107)
        self.assertEqual(block.HR[CONTROL] & 1, 0)
        line.ir[SESSION] += 1
        line.cycle(1.0, xExecute=False)
        line.cycle(1.0)
        before = block.HR[SYNC]
        line.cycle(xEnable=True)
        self.assertEqual((block.HR[CONTROL] & 1, block.HR[SYNC]), (1, before + 1), "in one write")
        self.assertTrue(block.xWriteControl)
        self.assertFalse(block.xWriteCommand)
        self.assertFalse(block.xReady)
        line.ir[SESSION] += 1
        line.cycle()
        self.assertTrue(line.cycle().xReady)

    def test_an_accepted_order_goes_on_while_the_line_is_in_hand(self):
        line = self.line()
        block = line.order()
        line.ir[ACK], line.ir[STATUS] = 42, 1
        line.cycle()
        line.cycle()
        line.cycle(xEnable=False)
        self.assertFalse(block.xError)
        line.ir[STATUS], line.ir[ACQ] = 3, 42
        line.cycle()
        self.assertTrue(block.xDone)

    def test_a_scan_is_done_by_its_own_number_and_not_by_somebody_elses_status(self):
        line = self.line()
        block = line.order()
        line.ir[ACK], line.ir[STATUS] = 42, 4  # another client has used the number
        for _ in range(5):
            line.cycle()
        self.assertFalse(block.xDone)
        line.ir[REFUSED] += 1
        line.ir[REFUSE_CODE], line.ir[REFUSE_SEQ] = 111, 42
        line.cycle()
        line.cycle()
        line.cycle()
        self.assertEqual(block.HR[CMD_SEQ], 43, "ordered again under the next number")
        line.ir[ACK], line.ir[STATUS] = 43, 1
        line.cycle()
        line.cycle()
        line.ir[STATUS], line.ir[ACQ] = 3, 43
        line.cycle()
        self.assertTrue(block.xDone)

    def test_an_order_given_too_early_begins_when_the_session_is_there(self):
        line = self.line()
        line.cycle(xExecute=True, uiCmd=2, uiStation=1)
        for _ in range(5):
            line.cycle()
        self.assertFalse(line.block.xWriteCommand)
        line.ir[SESSION] += 1
        written = False
        for _ in range(3):
            written |= line.cycle().xWriteCommand
        self.assertTrue(written)

    def test_an_order_that_never_can_begin_ends_in_an_error(self):
        line = self.line()
        line.cycle(xExecute=True, uiCmd=2, uiStation=1)
        for _ in range(70):
            line.cycle(1.0)
        self.assertTrue(line.block.xError)

    def test_an_order_is_written_as_it_was_when_it_began(self):
        line = self.line()
        block = line.order()
        line.inputs["uiStation"] = 17
        line.ir[SESSION] += 1
        for _ in range(4):
            line.cycle()
        self.assertEqual(block.HR[11], 1)

    def test_each_record_is_stored_for_itself(self):
        line = self.line()
        line.started()
        line.ir[5] |= 8
        line.ir[30] = line.ir[63] = 9
        line.cycle()
        self.assertTrue(line.block.xNewResult)
        line.cycle(xStored=True)
        self.assertEqual(line.block.HR[2], 9)
        line.ir[30] = line.ir[63] = 10
        for _ in range(5):
            line.cycle()  # xStored is still set
        self.assertEqual(line.block.HR[2], 9)
        self.assertTrue(line.block.xNewResult)
        line.cycle(xStored=False)
        line.cycle(xStored=True)
        self.assertEqual(line.block.HR[2], 10)

    def test_a_session_that_does_not_come_is_asked_for_again(self):
        line = self.line()
        line.cycle()
        self.assertEqual(line.block.HR[SYNC], 6)
        line.cycle(3.1)
        line.cycle()
        self.assertEqual(line.block.HR[SYNC], 7)


class StructuredText(Cases, unittest.TestCase):
    make = staticmethod(structured_text)


class Scl(Cases, unittest.TestCase):
    make = staticmethod(scl)


if __name__ == "__main__":
    unittest.main()
