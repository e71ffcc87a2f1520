#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""The SCL of docs/plc/siemens: same as FB_SLABD.st on random registers, CRC, names and codes of docs/PLC.md, and the
blocks around MB_SERVER and MB_CLIENT with emulations of these two instructions. This holds syntax, types and logic; it
does not show that TIA Portal compiles the files."""
import os
import random
import re
import unittest

from scl_block import FOLDER, siemens
from st_block import Block

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
MAGIC = [0x534C, 0x0101, 0x1234, 0x5678]


def crc16(registers):
    """CRC-16/Modbus over registers, high bytes first, or over bytes."""
    crc = 0xFFFF
    for byte in registers if isinstance(registers, bytes) else b"".join(word.to_bytes(2, "big") for word in registers):
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ 0xA001 if crc & 1 else crc >> 1
    return crc


def read(path):
    with open(path, encoding="utf-8") as file:
        return file.read()


class Slabd:
    """As much of slabd as one order needs: SESSION, CMD_ACK, ACQ_SEQ and a result for each SCAN."""

    def __init__(self):
        self.ir, self.hr = [0] * 110, [0] * 40
        self.ir[:4], self.ir[5], self.ir[9] = MAGIC, 0x201, 7
        self.sync, self.beats, self.scans = 0, 0, []

    def step(self):
        hr, ir = self.hr, self.ir
        self.beats += 1
        ir[4] = self.beats & 0xFFFF
        if hr[3] != self.sync:
            self.sync, ir[9] = hr[3], ir[9] + 1
        if hr[39] == ir[10] % 65535 + 1 and hr[38] == ir[9] and hr[1] & 1:
            assert hr[37] == crc16(hr[10:37])
            ir[10], ir[11], ir[12] = hr[39], 3 if hr[10] == 2 else 4, hr[39] if hr[10] == 2 else ir[12]
            self.scans.append(hr[10:37])
            ir[30] += 1
            ir[31:36] = [1, hr[39], hr[11], hr[14], hr[15]]
            ir[62], ir[63], ir[5] = crc16(ir[30:62]), ir[30], ir[5] | 8
        if ir[5] & 8 and hr[2] == ir[30]:
            ir[5] &= ~8


class MbClient:
    """MB_CLIENT as the manual describes it: a request begins with REQ and its parameters stay until DONE or ERROR."""

    slabd = None
    wait = 3
    down = False
    requests = []

    def __init__(self):
        self.DONE = self.BUSY = self.ERROR = False
        self.STATUS, self.running, self.left, self.old = 0, None, 0, False

    def __call__(self, REQ, DISCONNECT, MB_MODE, MB_DATA_ADDR, MB_DATA_LEN, MB_DATA_PTR, CONNECT):
        assert CONNECT.ActiveEstablished and CONNECT.ConnectionType == 11 and CONNECT.RemotePort == 1502
        assert len(MB_DATA_PTR) == MB_DATA_LEN and not DISCONNECT
        asked = (MB_MODE, MB_DATA_ADDR, MB_DATA_LEN, id(MB_DATA_PTR))
        self.DONE = self.ERROR = False
        if self.running is None:
            if REQ and not self.old:
                self.running, self.left = asked, self.wait
        else:
            assert REQ and asked == self.running, "the parameters changed while BUSY"
            self.left -= 1
            if self.left == 0:
                self.running = None
                self.ERROR, self.DONE = self.down, not self.down
                if self.DONE:
                    self.requests.append(asked[:3])
                    self.move(*asked[:3], MB_DATA_PTR)
        self.BUSY, self.STATUS, self.old = self.running is not None, 0x80C8 if self.ERROR else 0, REQ

    def move(self, mode, first, count, words):
        if mode == 104:
            words[:] = self.slabd.ir[first:first + count]
        else:
            assert mode == 116 and first + count <= 40
            self.slabd.hr[first:first + count] = words


class MbServer:
    """MB_SERVER: in each call one request of its client, here a reading of REG[0..39] or a writing behind it."""

    slabd = None

    def __init__(self):
        self.NDR = self.DR = self.ERROR = False
        self.STATUS, self.calls = 0, 0

    def __call__(self, DISCONNECT, MB_HOLD_REG, CONNECT):
        assert not CONNECT.ActiveEstablished and CONNECT.LocalPort == 502 and len(MB_HOLD_REG) == 150
        self.calls += 1
        if self.calls % 2:
            self.slabd.hr[:] = MB_HOLD_REG[:40]
            self.slabd.step()
        else:
            MB_HOLD_REG[40:] = self.slabd.ir


class Siemens(unittest.TestCase):
    def test_same_registers_as_the_structured_text(self):
        for seed in range(10):
            chance = random.Random(seed)
            now = [0.0]
            st = Block(os.path.join(ROOT, "docs/plc/FB_SLABD.st"), clock=lambda: now[0])
            scl = siemens(lambda: now[0]).instance("FB_SLABD")
            ir = [0] * 110
            ir[:4], ir[5], ir[9] = MAGIC, 0x201, 7
            inputs = {"uiSyncLast": 5, "xEnable": True, "xExecute": False, "uiCmd": 2, "xStored": False}
            steps = set()
            for cycle in range(1500):
                now[0] += chance.choice((0.01, 0.05, 0.2, 1.0))
                match chance.randrange(12):
                    case 0:
                        inputs["xExecute"] = not inputs["xExecute"]
                    case 1:
                        inputs.update(uiCmd=chance.randrange(1, 6), uiStation=chance.randrange(19), uiSlabType=5600,
                                      udSlabNo=chance.randrange(1 << 32),
                                      awSlabId=[chance.randrange(1 << 16) for _ in range(16)],
                                      awSecondId=[chance.randrange(1 << 16) for _ in range(16)],
                                      uiSlabTemperature=chance.randrange(1 << 16), uiSlabAge=chance.randrange(1 << 16),
                                      uiMould=chance.randrange(1 << 16))
                    case 2:
                        ir[9] += 1
                    case 3 | 4:
                        ir[10] = st.HR[39]
                        ir[11] = chance.choice((1, 2, 3, 4, 0x8000 + 103, 0x8000 + 107, 0x8000 + 205))
                    case 5:
                        ir[12] = st.HR[39]
                    case 6:
                        ir[21] += 1
                        ir[26], ir[27] = chance.choice((102, 111, 104)), st.HR[39]
                    case 7:
                        ir[5] = 0x200 | chance.randrange(16) | chance.choice((0, 0, 0, 32))
                        ir[20] = chance.randrange(4)
                    case 8:
                        ir[30] = chance.randrange(1, 1 << 16)
                        ir[63] = chance.choice((ir[30], ir[30], 0))
                    case 9:
                        inputs["xStored"] = not inputs["xStored"]
                    case 10:
                        inputs.update(xEnable=chance.random() < 0.9, xAbort=chance.random() < 0.2,
                                      xFaultReset=chance.random() < 0.2)
                    case 11:
                        ir[0] = chance.choice((0x534C, 0x534C, 0x534C, 0))
                link = chance.random() < 0.97
                st(IR=list(ir), xLinkOk=link, **inputs)
                scl(IR=list(ir), xLinkOk=link, **inputs)
                steps.add(st.uiStep)
                where = f"seed {seed}, cycle {cycle}"
                for name in ("xWriteControl", "xWriteCommand", "xReady", "xDone", "xError", "uiCode", "xNewResult",
                             "awRecord", "xWrongMap", "uiStep", "uiAttempts", "uiRewrites"):
                    self.assertEqual(getattr(scl, name), getattr(st, name), f"{name}, {where}")
                self.assertEqual(scl.HR[:37] + scl.HR[38:], st.HR[:37] + st.HR[38:], where)
                if scl.xWriteCommand:
                    self.assertEqual(scl.HR[37], crc16(scl.HR[10:37]), where)
            self.assertGreaterEqual(len(steps), 7, f"seed {seed} has seen too little")

    def test_crc_is_the_modbus_one(self):
        self.assertEqual(crc16(b"123456789"), 0x4B37)
        self.assertEqual(crc16([0x3132, 0x3334]), crc16(b"1234"))

    def test_counters_skip_zero(self):
        block = siemens(lambda: 0.0).instance("FB_SLABD")
        ir = MAGIC + [0] * 106
        ir[5], ir[10] = 0x201, 65535
        block(IR=ir, xLinkOk=True, uiSyncLast=65535)
        self.assertEqual(block.HR[3], 1)
        ir[9] = 1
        for _ in range(3):
            block(IR=ir, xLinkOk=True, xEnable=True, xExecute=True, uiCmd=1)
            ir[9] = 2
        self.assertEqual(block.HR[39], 1, "1 follows 65535")

    def test_text_of_slab_id(self):
        words = [0xFFFF] * 16
        siemens().function("FC_SLABD_ID", text="AB1", words=words)
        self.assertEqual(words, [0x4142, 0x3100] + [0] * 14)
        siemens().function("FC_SLABD_ID", text="x" * 40, words=words)
        self.assertEqual(words, [0x7878] * 16)

    def test_record_has_the_names_and_the_checksum_of_the_map(self):
        words = list(range(1000, 1034))
        words[12], words[13] = 0x8000, 0xFF06  # none, -0.250
        words[32], words[33] = crc16(words[:32]), words[0]
        found = siemens().function("FC_SLABD_RECORD", words=words)
        self.assertTrue(found.xIntact)
        record = found.record
        self.assertEqual((record.RES_SEQ, record.RES_STATION, record.VERDICT, record.FLATNESS, record.STD),
                         (1000, 1003, 1006, 1010, 1011))
        self.assertEqual(record.RES_SLAB_NO, 1004 << 16 | 1005)
        self.assertEqual((record.DEVIATION[42], record.DEVIATION[43], record.DEVIATION[55]), (-32768, -250, 1025))
        self.assertEqual((record.POINTS, record.SCAN_UTIME), (1026 << 16 | 1027, [1028, 1029, 1030, 1031]))
        words[5] ^= 1
        self.assertFalse(siemens().function("FC_SLABD_RECORD", words=words).xIntact)

    def test_names_and_addresses_are_those_of_the_map(self):
        page = read(os.path.join(ROOT, "docs/PLC.md"))
        table = re.findall(r"^\| ([\d.]+)(?:-\d+)? \| ([A-Z][A-Z_0-9]*) \|", page, re.M)
        inputs = {name: address for address, name in table[[name for _, name in table].index("MAGIC"):]}
        source = read(os.path.join(FOLDER, "FB_SLABD.scl"))
        fields = re.findall(r'#state\."?(\w+)"? := [^;]*?#IR\[(\d+)\](?:\.%X(\d+))?', source)
        self.assertGreater(len(fields), 30)
        for name, address, bit in fields:
            self.assertEqual(inputs[name], address + ("." + bit if bit else ""), name)
        fields = re.findall(r"#record\.(\w+) := [^;]*?#words\[(\d+)\]", source)
        self.assertGreater(len(fields), 12)
        for name, word in fields:
            self.assertEqual(inputs[name], str(int(word) + 30), name)

    def test_codes_and_commands_exist(self):
        map_page, source = read(os.path.join(ROOT, "docs/PLC.md")), read(os.path.join(FOLDER, "FB_SLABD.scl"))
        codes = set(re.findall(r"^\| (\d{3}) \| ", map_page, re.M))
        used = set(re.findall(r"#uiCode = (\d+)|#uiCode := (\d{3})|WORD_TO_UINT\(#IR\[26\]\) = (\d+)", source))
        used = {code for group in used for code in group if code}
        self.assertEqual(used, {"102", "103", "107", "110", "111"})
        self.assertLessEqual(used, codes)
        self.assertIn("(#uiCode = 103) OR (#uiCode = 107)", source)
        commands = re.search(r"uiCmd : UInt;   // (.*)", read(os.path.join(FOLDER, "SLABD_TYPES.udt"))).group(1)
        self.assertIn(commands, map_page)

    def order_by(self, block, slabd, cycle, address):
        """A SCAN, its result, a SLAB_END."""
        order = block.order
        order.xEnable, order.uiSlabType, order.udSlabNo = True, 5600, 70000
        words = [0] * 16
        siemens().function("FC_SLABD_ID", text="S-7", words=words)
        order.awSlabId = words
        order.awSecondId = words
        order.uiSlabTemperature, order.uiSlabAge, order.uiMould = 2931, 72, 12

        def until(done, what):
            for _ in range(3000):
                if done():
                    return
                order.xStored = block.answer.xNewResult
                cycle()
            self.fail(what)

        for command in (2, 3):
            until(lambda: block.answer.xReady, "READY")
            order.xExecute, order.uiCmd, order.uiStation = True, command, 4
            until(lambda: block.answer.xDone or block.answer.xError, "DONE")
            self.assertFalse(block.answer.xError, block.answer.uiCode)
            order.xExecute = False
            until(lambda: not block.answer.xDone, "idle")
        until(lambda: not slabd.ir[5] & 8, "RES_ACK")
        self.assertEqual([scan[:7] for scan in slabd.scans],
                         [[2, 4, 5600, 0, 1, 4464, 0x532D], [3, 4, 5600, 0, 1, 4464, 0x532D]])
        self.assertEqual([scan[22:26] for scan in slabd.scans], [[2931, 72, 12, crc16(words)]] * 2, "HR 32 to 35")
        self.assertEqual(slabd.hr[2], slabd.ir[30])

    def test_client_sends_one_request_at_a_time(self):
        now, slabd = [0.0], Slabd()
        MbClient.slabd, MbClient.down, MbClient.requests = slabd, False, []
        block = siemens(lambda: now[0], {"MB_CLIENT": MbClient, "MB_SERVER": MbServer}).instance("FB_SLABD_CLIENT")

        def cycle():
            now[0] += 0.005
            slabd.step()
            block(address=[0, 192, 168, 0, 2])

        self.order_by(block, slabd, cycle, 1502)
        self.assertEqual(set(MbClient.requests), {(104, 0, 110), (116, 0, 4), (116, 10, 30)})
        self.assertEqual(MbClient.requests.count((116, 10, 30)), 2, "one block for each order")
        self.assertEqual(block.uiSync, slabd.sync)
        MbClient.down = True
        for _ in range(10):
            cycle()
        self.assertFalse(block.answer.xLinkOk)
        self.assertFalse(block.answer.xReady)
        self.assertEqual(block.answer.wStatus, 0x80C8)
        MbClient.down = False
        for _ in range(10):
            cycle()
        self.assertTrue(block.answer.xReady)

    def test_server_shows_a_command_in_one_piece(self):
        now, slabd = [0.0], Slabd()
        MbServer.slabd = slabd
        block = siemens(lambda: now[0], {"MB_CLIENT": MbClient, "MB_SERVER": MbServer}).instance("FB_SLABD_SERVER")

        def cycle():
            now[0] += 0.005
            block(address=[0, 192, 168, 0, 2])

        self.order_by(block, slabd, cycle, 502)
        MbServer.slabd = Slabd()
        MbServer.slabd.step = lambda: None  # its heartbeat stops
        for _ in range(520):
            cycle()
        self.assertFalse(block.answer.xLinkOk)

    def test_faults_in_the_source_are_found(self):
        source = read(os.path.join(FOLDER, "FB_SLABD.scl"))
        crc = "#HR[37] := #wCrc;"
        for right, wrong in ((crc, "#HR[37] := #wCrcs;"), (crc, "#HR[37] := #uiCode;"), (crc, "#HR[37] := #wCrc"),
                             ("#IR[5].%X0 OR #xReadyDue", "#IR[5] OR #xReadyDue"),
                             ("#uiRewrites + 1", "#wRefused + 1"), ("END_CASE;", "END_IF;")):
            self.assertIn(right, source)
            with self.assertRaises(SyntaxError, msg=wrong):
                broken(source.replace(right, wrong, 1))


def broken(text):
    from scl_block import Source
    library = siemens()
    library.blocks.clear()
    Source(library, "broken", text).read()


if __name__ == "__main__":
    unittest.main()
