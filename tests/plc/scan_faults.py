# SPDX-License-Identifier: Apache-2.0
"""What can go wrong between a scanner and slabd, as two tables: files dropped badly, and a stream sent badly. The
emulated scanner's scans pass through DropScanner or StreamScanner, which deliver them as the current case requires."""
import os
import shutil
import socket
import struct
import threading
import time

BEGIN, BEFORE, EXPOSURE, READING, MEASURING, END = "SLAB_BEGIN", "before SCAN", "exposure", "reading", "measuring", "SLAB_END"
ALL = (BEGIN, BEFORE, EXPOSURE, READING, MEASURING, END)
OK, OFFLINE, TIMEOUT, INCOMPLETE, TOO_FEW, FULL = 0, 301, 302, 303, 401, 501


class Case:
    """One row of a table: what happens, and which codes the SCAN it happens to may end with, step by step. `do` is
    called at the step; `give` delivers the scan instead of an orderly scanner; `refused`: slabd must count it as such."""

    def __init__(self, name, codes, do=None, give=None, heal=None, refused=False):
        self.name, self.codes, self.do, self.give, self.heal, self.refused = name, codes, do, give, heal, refused


def at(steps, *codes):
    return {step: codes for step in steps}


# ---- files --------------------------------------------------------------------------------------------------------


class DropScanner(threading.Thread):
    """What a scanner's software does with the drop folder, well or badly."""

    def __init__(self, box):
        super().__init__(daemon=True)
        self.box, self.drop, self.sim = box, f"{box.dir}/drop", f"{box.dir}/sim"
        self.stop, self.case, self.step = False, None, None
        self.poison, self.last, self.next_name = b"", b"", "9-9"
        self.stem = "1-1"
        self.error = None

    def path(self, *names):
        return os.path.join(self.drop, *names)

    def put(self, name, data, folder="inbox"):
        part = self.path("part")
        with open(part, "wb") as file:
            file.write(data)
        os.rename(part, self.path(folder, name))

    def write(self, name, data, **kwargs):
        with open(self.path("inbox", name), "wb", **kwargs) as file:
            file.write(data)

    def run(self):
        seen = set()
        while not self.stop:
            try:
                for name in os.listdir(self.path("request")):
                    if name.endswith(".json") and not name.startswith(".") and name not in seen:
                        seen.add(name)
                        self.answer(name)
            except FileNotFoundError:
                pass
            except PermissionError as why:
                self.error = why
            time.sleep(0.005)

    def answer(self, name):
        self.stem = name[:-5]
        case = self.case
        if case is not None and self.step == EXPOSURE and case.do:
            case.do(self)
        shutil.copyfile(self.path("request", name) if os.path.exists(self.path("request", name)) else "/dev/null",
                        f"{self.sim}/{name}")
        os.rename(f"{self.sim}/{name}", f"{self.sim}/request/{name}")
        scan = f"{self.sim}/inbox/{self.stem}.ply"
        end = time.monotonic() + 15
        while not os.path.exists(scan) and not self.stop and time.monotonic() < end:
            time.sleep(0.005)
        if not os.path.exists(scan):
            return
        with open(scan, "rb") as file:
            data = file.read()
        os.unlink(scan)
        os.unlink(f"{self.sim}/request/{name}")
        self.last = data
        try:
            if case is not None and self.step == READING and case.give:
                case.give(self, f"{self.stem}.ply", data)
            else:
                self.put(f"{self.stem}.ply", data)
            if case is not None and self.step == READING and case.do:
                case.do(self)
        except OSError:  # no folder or no space: the scanner's software cannot continue
            pass


def half(scanner, name, data):
    scanner.write(name, data[:len(data) // 2])


def grows(scanner, name, data):
    with open(scanner.path("inbox", name), "wb") as file:
        for i in range(8):
            file.write(data[len(data) * i // 8:len(data) * (i + 1) // 8])
            file.flush()
            time.sleep(0.1)


def cut_while_read(scanner, name, data):
    scanner.put(name, data)
    time.sleep(0.02)
    os.truncate(scanner.path("inbox", name), len(data) // 3)


def renamed_over(scanner, name, data):
    scanner.put(name, data)
    for _ in range(20):
        if not os.path.exists(scanner.path("inbox", name)):
            break
        scanner.put(name, data)
        time.sleep(0.005)


def removed(scanner, name, data):
    scanner.put(name, data)
    time.sleep(0.01)
    try:
        os.unlink(scanner.path("inbox", name))
    except FileNotFoundError:
        pass


def years_off(years):
    def give(scanner, name, data):
        scanner.put("../part2", data)
        when = time.time() + years * 365 * 86400
        os.utime(scanner.path("part2"), (when, when))
        os.rename(scanner.path("part2"), scanner.path("inbox", name))
    return give


def twice(scanner, name, data):
    scanner.put(name, data)
    deadline = time.monotonic() + 5
    while os.path.exists(scanner.path("inbox", name)) and time.monotonic() < deadline:
        time.sleep(0.002)
    scanner.put(name, scanner.poison)


def away(scanner):
    os.rename(scanner.drop, scanner.drop + ".away")


def back(scanner):
    os.rename(scanner.drop + ".away", scanner.drop)


def fill(scanner):
    with open(scanner.path("filler"), "wb", buffering=0) as file:
        try:
            while True:
                file.write(b"\0" * 65536)
        except OSError:
            pass


def file_cases(root, small_disk):
    """`root`: slabd runs as another user, so that permissions hold; `small_disk`: the drop folder is a disk of its own."""
    everywhere = at(ALL, OK)
    cases = [
        Case("a stray scan", everywhere, lambda s: s.put("export_17.ply", s.poison)),
        Case("another request's name", everywhere, lambda s: s.put("1-60000.ply", s.poison)),
        Case("the last request's name again", everywhere, lambda s: s.put(f"{s.stem}.ply", s.poison)
             if s.step not in (EXPOSURE, READING) else s.put("7-7.ply", s.poison)),
        Case("a name that is never requested", everywhere, lambda s: s.put("7-7 (copy).PLY~", s.poison)),
        Case("an old file under the next name", at((BEGIN, BEFORE, MEASURING, END), OK, INCOMPLETE),
             lambda s: s.put(f"{s.next_name}.ply", s.poison)),
        Case("a flood of names", everywhere, lambda s: [s.write(f"n{i}", b"x") for i in range(60)]),
        Case("a link to another scan", everywhere, lambda s: (s.put("other.ply", s.poison, "."), os.symlink(
            "../other.ply", s.path("inbox", f"l{time.monotonic_ns()}.ply")))),
        Case("a folder", everywhere, lambda s: os.mkdir(s.path("inbox", f"d{time.monotonic_ns()}.ply"))),
        Case("half a file", at((READING,), INCOMPLETE), give=half),
        Case("an empty file", at((READING,), INCOMPLETE, TOO_FEW), give=lambda s, name, data: s.write(name, b"")),
        Case("no scan", at((READING,), INCOMPLETE, TOO_FEW), give=lambda s, name, data: s.put(name, b"hello\n" * 999)),
        Case("only a header", at((READING,), INCOMPLETE),
             give=lambda s, name, data: s.put(name, data[:data.index(b"end_header\n") + 11])),
        Case("grows in place", at((READING,), OK), give=grows),
        Case("cut while it is read", at((READING,), OK, INCOMPLETE, TOO_FEW), give=cut_while_read),
        Case("renamed over while it is read", at((READING,), OK, INCOMPLETE), give=renamed_over),
        Case("removed while it is read", at((READING,), OK, INCOMPLETE, TIMEOUT), give=removed),
        Case("delivered twice", at((READING,), OK), give=twice),
        Case("a link as the answer", at((READING,), INCOMPLETE), give=lambda s, name, data: (
            s.put("other.ply", s.poison, "."), os.symlink("../other.ply", s.path("inbox", name)))),
        Case("a folder as the answer", at((READING,), INCOMPLETE), give=lambda s, name, data: os.mkdir(
            s.path("inbox", name))),
        Case("never answered", at((READING,), TIMEOUT), give=lambda s, name, data: None),
        Case("a clock a year ahead", at((READING,), OK), give=years_off(1)),
        Case("a clock a year behind", at((READING,), OK), give=years_off(-1)),
        Case("a clock at zero", at((READING,), OK), give=years_off(-(time.time() / 86400 / 365))),
    ]
    if not small_disk:
        cases.append(Case("the folder gone, as a share that is cut", {
            BEGIN: (OK,), BEFORE: (OFFLINE,), EXPOSURE: (OFFLINE, TIMEOUT), READING: (OK, OFFLINE, TIMEOUT, INCOMPLETE),
            MEASURING: (OK,), END: (OK,)}, away, heal=back))
    if root:
        cases.append(Case("no permission", {
            BEGIN: (OK,), BEFORE: (OFFLINE,), EXPOSURE: (OFFLINE, TIMEOUT), READING: (OK, OFFLINE, TIMEOUT, INCOMPLETE),
            MEASURING: (OK,), END: (OK,)}, lambda s: os.chmod(s.path("inbox"), 0),
            heal=lambda s: os.chmod(s.path("inbox"), 0o2770)))
    if small_disk:
        cases.append(Case("a full disk", {
            BEGIN: (OK,), BEFORE: (FULL,), EXPOSURE: (INCOMPLETE, TIMEOUT), READING: (OK,), MEASURING: (OK,), END: (OK,)},
            fill, heal=lambda s: os.unlink(s.path("filler"))))
    return cases


# ---- a stream -----------------------------------------------------------------------------------------------------

TABLE = []
for _i in range(256):
    for _ in range(8):
        _i = (_i >> 1) ^ (0x82F63B78 if _i & 1 else 0)
    TABLE.append(_i)


def crc32c(data):
    crc = 0xFFFFFFFF
    for byte in data:
        crc = (crc >> 8) ^ TABLE[(crc ^ byte) & 255]
    return crc ^ 0xFFFFFFFF


def sealed(header):
    return header[:60] + struct.pack("<I", crc32c(header[:60]))


class Cut(Exception):
    """The cable is pulled here."""


class StreamScanner(threading.Thread):
    """Between the emulated gateway and slabd: passes lines one way and scans the other, well or badly."""

    def __init__(self, box, listen, slabd):
        super().__init__(daemon=True)
        self.box, self.slabd = box, slabd
        self.stop, self.case, self.step = False, None, None
        self.poison = self.last = b""
        self.server = socket.create_server(("127.0.0.1", listen))
        self.up, self.down, self.error = None, None, None
        self.away = False
        self.sent = 0
        self.others = []

    def run(self):
        while not self.stop:
            try:
                self.down = self.server.accept()[0]
                while self.away and not self.stop:
                    time.sleep(0.01)
                self.up = self.connect()
                lines = threading.Thread(target=self.pass_lines, args=(self.up, self.down), daemon=True)
                lines.start()
                self.pass_scans(self.up, self.down)
            except (OSError, Cut, ConnectionError):
                pass
            self.hang_up()

    def connect(self, source="127.0.0.1"):
        end = time.monotonic() + 5
        while True:
            try:
                return socket.create_connection(("127.0.0.1", self.slabd), timeout=20, source_address=(source, 0))
            except OSError:
                if time.monotonic() > end:
                    raise
                time.sleep(0.02)

    def hang_up(self):
        for link in (self.up, self.down):
            if link is not None:
                try:
                    link.shutdown(socket.SHUT_RDWR)
                except OSError:
                    pass
                link.close()

    def pass_lines(self, up, down):
        try:
            while data := up.recv(65536):
                if b"scan_request" in data and self.step == EXPOSURE and self.case is not None and self.case.do:
                    self.case.do(self)
                down.sendall(data)
        except OSError:
            pass
        for link in (up, down):
            try:
                link.shutdown(socket.SHUT_RDWR)
            except OSError:
                pass

    def pass_scans(self, up, down):
        while True:
            header = self.exactly(down, 64)
            count, first = struct.unpack_from("<II", header, 24)
            points = self.exactly(down, 12 * (count - first))
            if first == 0:
                self.last = header + points
            case, step = self.case, self.step
            if case is not None and step == READING and case.give:
                self.case = None  # the next try is orderly
                case.give(self, up, header, points)
            else:
                up.sendall(header + points)
            if case is not None and step == READING and case.do:
                self.case = None
                case.do(self)

    @staticmethod
    def exactly(link, count):
        data = bytearray()
        while len(data) < count:
            part = link.recv(min(1 << 20, count - len(data)))
            if not part:
                raise Cut
            data += part
        return bytes(data)

    def intrude(self, source):
        """Another user, with a whole scan of another block."""
        try:
            with self.connect(source) as other:
                other.sendall(self.poison)
                other.settimeout(0.2)
                other.recv(1)
        except OSError:
            pass


def cut_at(share=None, byte=None):
    def give(scanner, up, header, points):
        data = header + points
        end = byte if byte is not None else 64 + int(share * len(points))
        up.sendall(data[:end])
        time.sleep(0.02)
        raise Cut
    return give


def changed(offset, value, seal=True):
    def give(scanner, up, header, points):
        data = header[:offset] + value + header[offset + len(value):]
        up.sendall((sealed(data) if seal else data) + points)
    return give


def added(offset, step):
    def give(scanner, up, header, points):
        number = struct.unpack_from("<H", header, offset)[0]
        up.sendall(sealed(header[:offset] + struct.pack("<H", (number + step) % 65536) + header[offset + 2:]) + points)
    return give


def damaged(scanner, up, header, points):
    middle = len(points) // 2
    up.sendall(header + points[:middle] + bytes([points[middle] ^ 1]) + points[middle + 1:])


def stalled(scanner, up, header, points):
    up.sendall(header + points[:len(points) // 2])
    time.sleep(4.5)
    raise Cut


def trickles(scanner, up, header, points):
    for i in range(0, 64, 4):
        up.sendall(header[i:i + 4])
        time.sleep(0.01)
    for i in range(20):
        up.sendall(points[len(points) * i // 20:len(points) * (i + 1) // 20])
        time.sleep(0.02)


def gone(scanner):
    scanner.away = True
    scanner.hang_up()


def returns(scanner):
    scanner.away = False


def stream_cases():
    everywhere = at(ALL, OK)
    # The gateway may send a refused scan again as long as the request waits.
    refused = at((READING,), OK, INCOMPLETE)
    # The reference gateway reconnects and continues; it may also be too late.
    resumed = at((READING,), OK)
    cases = [
        Case("cut within the header", resumed, give=cut_at(byte=10)),
        Case("cut before the header's checksum", resumed, give=cut_at(byte=60)),
        Case("cut after the header", resumed, give=cut_at(byte=64)),
        Case("cut within the first point", resumed, give=cut_at(byte=70)),
        Case("cut in the middle", resumed, give=cut_at(share=0.5)),
        Case("cut before the last byte", resumed, give=cut_at(share=0.9999999)),
        Case("a damaged point", refused, give=damaged),
        Case("another magic", refused, give=changed(0, b"SLABSCAM")),
        Case("another version", refused, give=changed(8, b"\2\0")),
        Case("a damaged header", refused, give=changed(41, b"\xff", seal=False)),
        Case("another session", refused, give=added(12, 1)),
        Case("an earlier sequence", refused, give=added(14, -1)),
        Case("a skipped sequence", refused, give=added(14, 1)),
        Case("more points than there may be", refused, give=changed(24, struct.pack("<I", 6_000_001))),
        Case("a first point beyond the last", refused, give=changed(28, b"\xff\xff\xff\x7f")),
        Case("another unit", refused, give=changed(32, b"\7\0\0\0")),
        Case("an earlier scan whole", refused, give=lambda s, up, header, points: up.sendall(s.poison)),
        Case("the scan twice", at((READING,), OK), give=lambda s, up, header, points: up.sendall(2 * (header + points))),
        Case("bytes behind the scan", at((READING,), OK), give=lambda s, up, h, p: up.sendall(h + p + b"more" * 99)),
        Case("never answered", at((READING,), TIMEOUT), give=lambda s, up, header, points: time.sleep(5)),
        Case("stalled in the middle", at((READING,), OK, INCOMPLETE, TIMEOUT), give=stalled),
        Case("bit by bit", at((READING,), OK), give=trickles),
        Case("a sender that may not", everywhere, lambda s: s.intrude("127.0.0.9")),
        Case("a second sender", everywhere, lambda s: s.intrude("127.0.0.2")),
        Case("a second sender from the same place", {
            BEGIN: (OK,), BEFORE: (OK, OFFLINE, INCOMPLETE), EXPOSURE: (OK, INCOMPLETE, TIMEOUT),
            READING: (OK, INCOMPLETE, TIMEOUT), MEASURING: (OK,), END: (OK,)}, lambda s: s.intrude("127.0.0.1")),
        Case("the gateway gone", {
            BEGIN: (OK,), BEFORE: (OFFLINE,), EXPOSURE: (OFFLINE, TIMEOUT, INCOMPLETE), READING: (OK,), MEASURING: (OK,),
            END: (OK,)}, gone, heal=returns),
    ]
    for case in cases:
        case.refused = case.codes is refused
    return cases
