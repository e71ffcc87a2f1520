#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""A GigE Vision 3-D camera in software, for tests: GVCP (control, heartbeat, packet resend) and GVSP (image, chunk and
multi-part frames). Written after the published layout of the packets, and checked by a foreign client (arv-tool). It
shares no code with the gateway or with Aravis.

camera_device.py --address 127.0.0.9 --frames FOLDER [--loss 0.05 ...]; each trigger sends the next PLY of the folder.
Lines on stdin change an option while it runs: "loss 0.2", "fault overlap", "die half". It prints "ready" and events."""

import argparse
import os
import pathlib
import random
import select
import signal
import socket
import struct
import sys
import time

import numpy as np

PORT = 3956
XML_ADDRESS = 0x100000
# Bootstrap registers.
DISCOVERY_BYTES = 0xF8
CAPABILITY, HEARTBEAT = 0x934, 0x938
TICKS_HIGH, TICKS_LOW, CLOCK_CONTROL, CLOCK_HIGH, CLOCK_LOW = 0x93C, 0x940, 0x944, 0x948, 0x94C
PRIVILEGE, STREAM_PORT, PACKET_SIZE, STREAM_ADDRESS = 0xA00, 0xD00, 0xD04, 0xD18
# The camera's own registers, four bytes each, big-endian.
NAMES = ["Width", "Height", "PixelFormat", "PayloadSize", "AcquisitionMode", "AcquisitionStart", "AcquisitionStop",
         "TriggerSelector", "TriggerMode", "TriggerSource", "TriggerSoftware", "ComponentSelector", "ComponentEnable",
         "ComponentIDValue", "Scan3dDistanceUnit", "Scan3dOutputMode", "Scan3dCoordinateSystem",
         "Scan3dCoordinateSystemReference", "Scan3dCoordinateSelector", "Scan3dCoordinateScale",
         "Scan3dCoordinateOffset", "Scan3dInvalidDataFlag", "Scan3dInvalidDataValue", "ChunkModeActive", "ExposureTime"]
REGISTER = {name: 0x10000 + 4 * i for i, name in enumerate(NAMES)}
NAME_OF = {address: name for name, address in REGISTER.items()}
FORMATS = {"Coord3D_ABC32f": 0x026000C0, "Coord3D_ABC16": 0x023000B9, "Coord3D_ABC32f_Planar": 0x026000C1,
           "Coord3D_ABC16_Planar": 0x023000BA, "Mono8": 0x01080001}
COMPONENTS = {"Intensity": 1, "Range": 4, "Confidence": 6}
BYTES_OF = {"Intensity": 1, "Confidence": 1}  # a pixel
ENTRIES = {
    "AcquisitionMode": {"Continuous": 0, "SingleFrame": 1},
    "TriggerSelector": {"FrameStart": 0, "AcquisitionStart": 1},
    "TriggerMode": {"Off": 0, "On": 1},
    "TriggerSource": {"Line0": 0, "Software": 1},
    "ComponentSelector": COMPONENTS,
    "Scan3dDistanceUnit": {"Millimeter": 0, "Inch": 1},
    "Scan3dOutputMode": {"CalibratedABC_PointCloud": 0, "CalibratedABC_Grid": 1},
    "Scan3dCoordinateSystem": {"Cartesian": 0, "Spherical": 1},
    "Scan3dCoordinateSystemReference": {"Anchor": 0, "Transformed": 1},
    "Scan3dCoordinateSelector": {"CoordinateA": 0, "CoordinateB": 1, "CoordinateC": 2},
}
FLOATS = {"Scan3dCoordinateScale", "Scan3dCoordinateOffset", "Scan3dInvalidDataValue", "ExposureTime"}
BOOLEANS = {"ComponentEnable", "Scan3dInvalidDataFlag", "ChunkModeActive"}
COMMANDS = {"AcquisitionStart", "AcquisitionStop", "TriggerSoftware"}
READ_ONLY = {"Width", "Height", "PayloadSize", "ComponentIDValue", "Scan3dCoordinateScale", "Scan3dCoordinateOffset"}
STRINGS = {"DeviceVendorName": (0x48, 32), "DeviceModelName": (0x68, 32), "DeviceFirmwareVersion": (0x88, 32),
           "DeviceSerialNumber": (0xD8, 16)}
# GVCP status codes.
BAD_ADDRESS, ACCESS_DENIED, UNAVAILABLE = 0x8003, 0x8006, 0x800C


def description(formats, without):
    """GenApi XML of the features."""
    names = [n for n in NAMES if n not in without]
    out = ['<?xml version="1.0" encoding="utf-8"?>',
           '<RegisterDescription ModelName="Range" VendorName="slabd" StandardNameSpace="GEV" SchemaMajorVersion="1" '
           'SchemaMinorVersion="1" SchemaSubMinorVersion="0" MajorVersion="1" MinorVersion="0" SubMinorVersion="0" '
           'ToolTip="Test device" ProductGuid="0" VersionGuid="0" xmlns="http://www.genicam.org/GenApi/Version_1_1">',
           '<Category Name="Root"><pFeature>DeviceControl</pFeature><pFeature>ScanControl</pFeature></Category>',
           '<Category Name="DeviceControl">' + "".join(f"<pFeature>{n}</pFeature>" for n in STRINGS) + "</Category>",
           '<Category Name="ScanControl">' + "".join(f"<pFeature>{n}</pFeature>" for n in names) + "</Category>"]
    for name, (address, length) in STRINGS.items():
        out.append(f'<StringReg Name="{name}"><Address>{address}</Address><Length>{length}</Length>'
                   "<AccessMode>RO</AccessMode><pPort>Device</pPort></StringReg>")
    for name in names:
        mode = "WO" if name in COMMANDS else "RO" if name in READ_ONLY else "RW"
        body = (f"<Address>{REGISTER[name]}</Address><Length>4</Length><AccessMode>{mode}</AccessMode>"
                "<pPort>Device</pPort><Cachable>NoCache</Cachable>")
        number = "<Sign>Unsigned</Sign><Endianess>BigEndian</Endianess>"
        if name in FLOATS:
            out.append(f'<FloatReg Name="{name}">{body}<Endianess>BigEndian</Endianess></FloatReg>')
            continue
        entries = formats if name == "PixelFormat" else ENTRIES.get(name)
        if entries is None and name not in COMMANDS | BOOLEANS:
            out.append(f'<IntReg Name="{name}">{body}{number}</IntReg>')
            continue
        out.append(f'<IntReg Name="{name}Reg">{body}{number}</IntReg>')
        value = f"<pValue>{name}Reg</pValue>"
        if name in COMMANDS:
            out.append(f'<Command Name="{name}">{value}<CommandValue>1</CommandValue></Command>')
        elif name in BOOLEANS:
            out.append(f'<Boolean Name="{name}">{value}<OnValue>1</OnValue><OffValue>0</OffValue></Boolean>')
        else:
            entry = "".join(f'<EnumEntry Name="{n}"><Value>{v}</Value></EnumEntry>' for n, v in entries.items())
            out.append(f'<Enumeration Name="{name}">{entry}{value}</Enumeration>')
    out.append('<Port Name="Device"></Port></RegisterDescription>')
    return "\n".join(out).encode()


def read_ply(path):
    """Width, height and points (n, 3) of a binary little-endian PLY with float x y z."""
    data = pathlib.Path(path).read_bytes()
    end = data.index(b"end_header\n") + len(b"end_header\n")
    words = data[:end].split()
    count = int(words[words.index(b"vertex") + 1])
    width, height = count, 1
    if b"organized" in words:
        width, height = (int(words[words.index(key) + 1]) for key in (b"width", b"height"))
    return width, height, np.frombuffer(data, "<f4", 3 * count, end).reshape(count, 3)


class Frame:
    """One frame as packets: number 0 is the leader, the last one the trailer."""

    def __init__(self, device, block_id, points, timestamp_ns):
        self.block_id, self.multipart, self.chunks = block_id, device.options.multipart, device.registers["ChunkModeActive"]
        fault = device.options.fault
        parts = [("Range", device.encode(points))]
        if self.multipart:
            pixels = device.width * device.height
            parts = [(name, bytes(pixels * BYTES_OF[name]) if name in BYTES_OF else parts[0][1])
                     for name in COMPONENTS if name == "Range" or device.enabled[name] or fault == "all_parts"]
            if fault == "two_ranges":
                parts.append(("Range", parts[-1][1]))
            if fault == "no_range":
                parts = [("Intensity", bytes(pixels))]
        payload = b"".join(data for _, data in parts)
        if self.chunks:
            tag = struct.pack(">II", 0x1, len(payload))
            extra = struct.pack("<Q", timestamp_ns) + struct.pack(">II", 0x7, 8)
            payload = payload + tag + extra
            if fault == "chunk_size":
                payload = payload[:-4] + struct.pack(">I", 0x7FFFFFFF)
        if fault == "short":
            payload = payload[:-5000]
        self.payload = memoryview(payload)
        overhead = 48 + 8 if self.multipart else 36
        self.block = device.word(PACKET_SIZE) % 65536 - overhead
        width, height = device.width, device.height
        if fault == "narrow":
            width -= 1
        if fault == "padding":
            pad = 4
        else:
            pad = 0
        code = FORMATS["Mono8"] if fault == "mono" else device.registers["PixelFormat"]
        high, low = timestamp_ns >> 32, timestamp_ns & 0xFFFFFFFF
        self.cuts = []  # (begin, end) of each block
        if self.multipart:
            leader = struct.pack(">HHII", 0, 0x000A, high, low)
            begin = 0
            for name, data in parts:
                leader += struct.pack(">HHIIHBBIHHIIIIHHI", 0x0005 if name == "Range" else 0x0001, 0, len(data),
                                      code if name == "Range" else FORMATS["Mono8"], 0, 0, 0, 0, COMPONENTS[name], 0,
                                      width, height, 0, 0, pad, 0, 0)
                # No packet holds bytes of two parts.
                self.cuts += [(b, min(b + self.block, begin + len(data)))
                              for b in range(begin, begin + len(data), self.block)]
                begin += len(data)
            self.parts = len(parts)
        else:
            kind = 0x4001 if self.chunks else 0x0007 if fault == "payload_type" else 0x0001
            leader = struct.pack(">HHIIIIIIIHH", 0, kind, high, low, code, width, height, 0, 0, pad, 0)
            self.cuts = [(b, min(b + self.block, len(payload))) for b in range(0, len(payload), self.block)]
            self.parts = 0
        self.leader = leader
        self.trailer = struct.pack(">II", 0x000A if self.multipart else 1, height)
        self.fault = fault

    def count(self):
        return len(self.cuts) + 2

    def packet(self, number, status=0):
        """Header and data of a packet."""
        last = self.count() - 1
        kind = 1 if number == 0 else 2 if number == last else 7 if self.multipart else 3
        if self.multipart:
            info = (0x80 | kind) << 24 | (self.parts if kind == 1 else 0)
            head = struct.pack(">HHIQI", status, 0, info, self.block_id, number)
        else:
            head = struct.pack(">HHI", status, self.block_id & 0xFFFF, kind << 24 | number)
        if status & 0x8000:
            return head, b""
        if number == 0:
            return head, self.leader
        if number == last:
            return head, self.trailer
        begin, end = self.cuts[number - 1]
        if self.multipart:
            place = begin
            if self.fault == "overlap" and number == 20:
                place = self.cuts[17][0]
            head += struct.pack(">BBHI", 0, 0, place >> 32, place & 0xFFFFFFFF)
        return head, self.payload[begin:end]


class Device:
    def __init__(self, options):
        self.options = options
        self.rng = random.Random(options.seed)
        self.files = sorted(pathlib.Path(options.frames).glob("*.ply"))
        self.next_file = 0
        self.width, self.height, _ = read_ply(self.files[0])
        self.formats = {name: code for name, code in FORMATS.items() if name in options.formats.split(",")}
        self.registers = {name: 0 for name in NAMES}
        self.registers.update(Width=self.width, Height=self.height, PixelFormat=next(iter(self.formats.values())),
                              ComponentSelector=COMPONENTS["Intensity"], Scan3dOutputMode=options.output_mode,
                              Scan3dDistanceUnit=options.unit)
        self.registers["ChunkModeActive"] = int(options.chunks)
        self.exposure = 10000.0
        self.enabled = {name: True for name in COMPONENTS}
        self.axes = [[s, o, options.invalid] for s, o in ((0.01, -300.0), (0.01, -300.0), (0.01, 300.0))]
        self.memory = bytearray(XML_ADDRESS)
        for name, text in (("DeviceVendorName", "slabd"), ("DeviceModelName", "Test Range"),
                           ("DeviceFirmwareVersion", options.firmware), ("DeviceSerialNumber", options.serial)):
            address, length = STRINGS[name]
            self.memory[address:address + length] = text.encode().ljust(length, b"\0")
        self.memory[0x24:0x28] = socket.inet_aton(options.address)
        without = set(options.without.split(",")) if options.without else set()
        self.xml = description(self.formats, without)
        self.memory[0x200:0x400] = f"Local:device.xml;{XML_ADDRESS:x};{len(self.xml):x}".encode().ljust(512, b"\0")
        for address, value in ((0x0, 0x00020000), (0x4, 0x80000001), (0x904, 1), (HEARTBEAT, options.heartbeat_ms),
                               (TICKS_LOW, 0 if options.no_clock else 1_000_000_000), (PACKET_SIZE, 1500),
                               (CAPABILITY, 0x2 | (0 if options.no_resend else 0x4)), (0x600, 1)):
            self.put(address, value)
        self.controller = None
        self.heard = 0.0
        self.acquiring = False
        self.block_id = 0
        self.recent = []  # frames that are kept for resend
        self.queue = []
        self.held = None  # a frame that is sent with the next trigger
        self.due = None   # time and frame
        self.sent = self.dropped = self.resent = 0
        self.control = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.control.bind((options.address, PORT))
        self.stream = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.stream.bind((options.address, 0))
        self.stream.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 4_000_000)
        self.input = b""

    def say(self, text):
        print(text, flush=True)

    def step(self, name):
        """Dies at the step that "die NAME" names, without a farewell."""
        if self.options.die == name:
            self.say(f"dies at {name}")
            os.kill(os.getpid(), signal.SIGKILL)

    # ---- registers

    def word(self, address):
        return struct.unpack_from(">I", self.memory, address)[0]

    def put(self, address, value):
        struct.pack_into(">I", self.memory, address, value & 0xFFFFFFFF)

    def payload_bytes(self):
        pixels = self.width * self.height
        size = pixels * (6 if self.registers["PixelFormat"] in (0x023000B9, 0x023000BA) else 12)
        if self.options.multipart:
            size += sum(pixels * BYTES_OF[n] for n in BYTES_OF)
            if self.options.fault == "two_ranges":
                size += pixels * 12
        if self.registers["ChunkModeActive"]:
            size += 8 + 16
        if self.options.fault == "payload_size":
            size -= 4
        return size

    def read(self, address):
        """A register's value; None: there is no such register."""
        name = NAME_OF.get(address)
        if name is None:
            return self.word(address) if address + 4 <= len(self.memory) else None
        axis = self.axes[self.registers["Scan3dCoordinateSelector"] % 3]
        component = next((n for n, v in COMPONENTS.items() if v == self.registers["ComponentSelector"]), "Range")
        values = {"PayloadSize": self.payload_bytes, "ComponentIDValue": lambda: COMPONENTS[component],
                  "ComponentEnable": lambda: int(self.enabled[component]),
                  "Scan3dInvalidDataFlag": lambda: int(axis[2] is not None)}
        floats = {"Scan3dCoordinateScale": axis[0], "Scan3dCoordinateOffset": axis[1],
                  "Scan3dInvalidDataValue": 0.0 if axis[2] is None else axis[2], "ExposureTime": self.exposure}
        if name in floats:
            if self.registers["PixelFormat"] in (0x026000C0, 0x026000C1) and name != "ExposureTime":
                floats.update(Scan3dCoordinateScale=1.0, Scan3dCoordinateOffset=0.0)
            return struct.unpack(">I", struct.pack(">f", floats[name]))[0]
        return values[name]() if name in values else self.registers[name]

    def write(self, address, value):
        if address == PRIVILEGE and value == 0:
            self.release()
            return
        if address == CLOCK_CONTROL and value & 2:
            now = time.monotonic_ns()
            self.put(CLOCK_HIGH, now >> 32)
            self.put(CLOCK_LOW, now)
            return
        name = NAME_OF.get(address)
        if name is None:
            self.put(address, value)
            return
        component = next((n for n, v in COMPONENTS.items() if v == self.registers["ComponentSelector"]), "Range")
        if name == "ComponentEnable":
            self.enabled[component] = value != 0
        elif name == "ExposureTime":
            self.exposure = struct.unpack(">f", struct.pack(">I", value))[0]
        elif name == "AcquisitionStart":
            self.step("start")
            self.acquiring = True
            if self.registers["AcquisitionMode"] == 1:
                self.trigger()
        elif name == "AcquisitionStop":
            self.acquiring = False
            self.queue = []
        elif name == "TriggerSoftware":
            self.step("trigger")
            if self.acquiring and self.registers["TriggerMode"] == 1 and self.registers["TriggerSource"] == 1:
                self.trigger()
        elif name not in READ_ONLY:
            self.registers[name] = value

    def release(self):
        self.controller = None
        self.acquiring = False
        self.queue = []
        self.put(PRIVILEGE, 0)
        self.put(STREAM_PORT, 0)

    # ---- frames

    def encode(self, points):
        """The component's bytes in the current pixel format."""
        code = self.registers["PixelFormat"]
        if code == FORMATS["Coord3D_ABC32f"]:
            return np.ascontiguousarray(points, "<f4").tobytes()
        if code == FORMATS["Coord3D_ABC32f_Planar"]:
            return np.ascontiguousarray(points.T, "<f4").tobytes()
        missing = ~np.isfinite(points).all(axis=1)
        counts = np.empty(points.shape, "<u2")
        for i, (scale, offset, invalid) in enumerate(self.axes):
            raw = np.rint((points[:, i].astype(float) - offset) / scale)
            counts[:, i] = np.where(missing, 0 if invalid is None else invalid, np.clip(raw, 1, 65534))
        return (counts.T if code == FORMATS["Coord3D_ABC16_Planar"] else counts).tobytes()

    def trigger(self):
        path = self.files[self.next_file % len(self.files)]
        self.next_file += 1
        _, _, points = read_ply(path)
        self.block_id = self.block_id % 65535 + 1
        now = time.monotonic_ns()
        self.say(f"trigger {path.name}")
        fault = self.options.fault
        if fault == "no_frame":
            return
        frame = Frame(self, self.block_id, points, now)
        if fault == "slow":  # sent later, whatever happens in between
            self.due, self.options.fault = (time.monotonic() + 5.0, frame), ""
            return
        if fault == "late":  # sent with the next trigger, before its own frame
            self.held, self.options.fault = frame, ""
            return
        frames = [frame]
        if self.held is not None:
            self.held.block_id, frame.block_id = frame.block_id, frame.block_id % 65535 + 1
            self.block_id = frame.block_id
            frames.insert(0, self.held)
            self.held = None
        self.queue = []
        for one in frames:
            numbers = list(range(one.count()))
            n = self.options.reorder
            if n > 1:
                for begin in range(0, len(numbers), n):
                    window = numbers[begin:begin + n]
                    self.rng.shuffle(window)
                    numbers[begin:begin + n] = window
            self.queue += [(one, number) for number in numbers]
        self.queue.reverse()
        self.recent = frames
        self.sent = self.dropped = self.resent = 0

    def send(self, frame, number, status=0):
        if self.word(STREAM_PORT) == 0:
            return
        target = (socket.inet_ntoa(self.memory[STREAM_ADDRESS:STREAM_ADDRESS + 4]), self.word(STREAM_PORT) & 0xFFFF)
        if self.rng.random() < self.options.loss:
            self.dropped += 1
            return
        self.stream.sendmsg(frame.packet(number, status), (), 0, target)
        self.sent += 1
        if self.options.duplicate and self.rng.random() < self.options.duplicate:
            self.stream.sendmsg(frame.packet(number, status), (), 0, target)

    def pump(self):
        """Sends some packets of the current frame."""
        for _ in range(32):
            if not self.queue:
                return
            frame, number = self.queue.pop()
            if number == 1:
                self.step("leader")
            if number == frame.count() // 2:
                self.step("half")
            if number == frame.count() - 1:
                self.step("trailer")
            self.send(frame, number)
        if not self.queue:
            self.say(f"sent {self.sent} dropped {self.dropped}")
        if self.options.mbit:
            time.sleep(32 * self.word(PACKET_SIZE) % 65536 * 8e-6 / self.options.mbit)

    def resend(self, data, extended):
        if extended:
            _, first, last, block_id = struct.unpack_from(">IIIQ", data)
        else:
            block_id, first, last = struct.unpack_from(">III", data)
        for number in range(first, min(last, first + 100_000) + 1):
            frame = next((one for one in self.recent if one.block_id == block_id), None)
            if frame is None or number >= frame.count():
                continue
            self.resent += 1
            self.send(frame, number, UNAVAILABLE if self.options.fault == "forgets" else 0)

    # ---- control

    def answer(self, data, sender):
        if len(data) < 8 or data[0] != 0x42:
            return
        _, flags, command, size, number = struct.unpack_from(">BBHHH", data)
        body = data[8:8 + size]
        if self.controller is not None and time.monotonic() - self.heard > self.word(HEARTBEAT) / 1000:
            self.say("heartbeat timeout")
            self.release()
        is_controller = self.controller == sender
        if is_controller:
            self.heard = time.monotonic()

        def reply(code, payload=b"", status=0):
            self.control.sendto(struct.pack(">HHHH", status, code, len(payload), number) + payload, sender)

        if command == 0x0002:
            reply(0x0003, bytes(self.memory[:DISCOVERY_BYTES]))
        elif command == 0x0080:
            values = [self.read(a) for a in struct.unpack(f">{len(body) // 4}I", body[:len(body) // 4 * 4])]
            if None in values:
                reply(0x0081, status=BAD_ADDRESS)
            else:
                reply(0x0081, struct.pack(f">{len(values)}I", *values))
        elif command == 0x0084:
            address, count = struct.unpack(">IHH", body)[0], struct.unpack(">IHH", body)[2]
            text = self.xml.ljust((len(self.xml) + 3) // 4 * 4, b"\0")
            whole = text[address - XML_ADDRESS:] if address >= XML_ADDRESS else self.memory[address:]
            if address in NAME_OF:
                whole = struct.pack(">I", self.read(address))
            reply(0x0085, struct.pack(">I", address) + bytes(whole[:count]).ljust(count, b"\0"))
        elif command in (0x0082, 0x0086):
            pairs = []
            if command == 0x0082:
                words = struct.unpack(f">{len(body) // 4}I", body[:len(body) // 4 * 4])
                pairs = list(zip(words[::2], words[1::2]))
            else:
                address = struct.unpack_from(">I", body)[0]
                pairs = [(address + i, struct.unpack_from(">I", body, 4 + i)[0]) for i in range(0, len(body) - 4, 4)]
            takes = self.controller is None and pairs and pairs[0][0] == PRIVILEGE and pairs[0][1] != 0
            if not (takes or is_controller):
                reply(command + 1, status=ACCESS_DENIED)
                return
            if takes:
                self.step("open")
                self.controller, self.heard = sender, time.monotonic()
                self.say("controlled")
            for address, value in pairs:
                self.write(address, value)
            reply(command + 1, struct.pack(">HH", 0, len(pairs)) if command == 0x0082 else struct.pack(">HH", 0, 0))
        elif command == 0x0040 and not self.options.no_resend:
            self.resend(body, flags & 0x10 != 0)

    def change(self, line):
        key, _, value = line.partition(" ")
        if key == "again":  # the frame before, for a request that failed
            self.next_file -= 1
            self.say("set back")
            return
        kind = type(getattr(self.options, key)) if getattr(self.options, key) is not None else str
        setattr(self.options, key, kind(value) if kind is not bool else value == "1")
        if key == "firmware":
            address, length = STRINGS["DeviceFirmwareVersion"]
            self.memory[address:address + length] = value.encode().ljust(length, b"\0")
        self.say(f"set {key}")

    def run(self):
        self.say("ready")
        watched = [self.control, sys.stdin]
        while True:
            ready, _, _ = select.select(watched, [], [], 0 if self.queue else 0.2)
            if self.control in ready:
                data, sender = self.control.recvfrom(2048)
                self.answer(data, sender)
            if sys.stdin in ready:
                piece = os.read(0, 4096)
                if not piece:
                    watched.remove(sys.stdin)
                self.input += piece
                while b"\n" in self.input:
                    line, self.input = self.input.split(b"\n", 1)
                    self.change(line.decode())
            if self.due is not None and time.monotonic() >= self.due[0]:
                late, self.due = self.due[1], None
                self.queue += [(late, number) for number in reversed(range(late.count()))]
            if self.queue:
                self.pump()


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--address", required=True, help="of this computer: 127.0.0.9")
    parser.add_argument("--frames", required=True, help="folder with one PLY for each trigger")
    parser.add_argument("--formats", default="Coord3D_ABC32f", help="pixel formats, the first one is set")
    parser.add_argument("--multipart", action="store_true")
    parser.add_argument("--chunks", action="store_true")
    parser.add_argument("--loss", type=float, default=0.0, help="share of the packets that are not sent")
    parser.add_argument("--duplicate", type=float, default=0.0)
    parser.add_argument("--reorder", type=int, default=0, help="shuffle packets in windows of this size")
    parser.add_argument("--no-resend", action="store_true")
    parser.add_argument("--no-clock", action="store_true")
    parser.add_argument("--mbit", type=float, default=0.0, help="limit of the rate, Mbit/s")
    parser.add_argument("--heartbeat-ms", type=int, default=3000)
    parser.add_argument("--invalid", type=float, default=None, help="Scan3dInvalidDataValue of all coordinates")
    parser.add_argument("--unit", type=int, default=0)
    parser.add_argument("--output-mode", type=int, default=1)
    parser.add_argument("--firmware", default="1.13.4")
    parser.add_argument("--serial", default="T-0001")
    parser.add_argument("--without", default="", help="features that the camera does not have")
    parser.add_argument("--fault", default="", help="of the frames: short, overlap, late, no_frame, forgets, ...")
    parser.add_argument("--die", default="", help="step at which the process kills itself: open, start, trigger, "
                                                  "leader, half, trailer")
    parser.add_argument("--seed", type=int, default=1)
    Device(parser.parse_args()).run()


if __name__ == "__main__":
    main()
