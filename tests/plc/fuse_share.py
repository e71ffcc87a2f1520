# SPDX-License-Identifier: Apache-2.0
"""A network share that misbehaves on request: a folder seen through FUSE, with the kernel's protocol spoken here, so
that nothing but root and /dev/fuse is needed. What the kernel does with a share that hangs, forgets, fails or goes away
is the kernel's own; the server's part is played. The user of this class must not touch the mounted folder itself: this process
would wait for itself.

Faults: freeze() and thaw() (the server stops, in the middle of a call), fail(errno, operations), break_off() (the
connection is gone: ENOTCONN until come_back()), `keeps_s` (how long the kernel may remember names, sizes and times),
`skew_s` (the server's clock)."""
import ctypes
import errno
import os
import select
import stat
import struct
import threading

LIBC = ctypes.CDLL(None, use_errno=True)
LOOKUP, FORGET, GETATTR, SETATTR, MKDIR, UNLINK, RMDIR, RENAME = 1, 2, 3, 4, 9, 10, 11, 12
OPEN, READ, WRITE, STATFS, RELEASE, FSYNC, FLUSH, INIT, OPENDIR, READDIR = 14, 15, 16, 17, 18, 20, 25, 26, 27, 28
RELEASEDIR, FSYNCDIR, CREATE, INTERRUPT, BATCH_FORGET, RENAME2 = 29, 30, 35, 36, 42, 45
ANY = frozenset(range(1, 64))
UMOUNT_DETACH = 2


def available():
    return os.geteuid() == 0 and os.access("/dev/fuse", os.R_OK | os.W_OK)


class Share:
    def __init__(self, behind, mounted):
        self.behind, self.mounted = behind, mounted
        self.keeps_s, self.skew_s = 0.0, 0
        self.failing = (0, frozenset())
        self.calls = 0
        self.answers = threading.Event()
        self.answers.set()
        self.come_back()

    # ---- faults

    def come_back(self):
        self.paths, self.nodes, self.handles = {1: self.behind}, {}, {}
        fd = os.open("/dev/fuse", os.O_RDWR)
        data = f"fd={fd},rootmode=40000,user_id=0,group_id=0,allow_other"
        if LIBC.mount(b"share", self.mounted.encode(), b"fuse.share", 0, data.encode()) != 0:
            raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))
        self.over = False
        self.thread = threading.Thread(target=self.serve, args=(fd,), daemon=True)
        self.thread.start()

    def break_off(self):
        """The server is gone: the kernel ends every call under way, and every later one, with an error."""
        self.over = True
        self.answers.set()
        self.thread.join()

    def unmount(self):
        LIBC.umount2(self.mounted.encode(), UMOUNT_DETACH)

    def freeze(self):
        self.answers.clear()

    def thaw(self):
        self.answers.set()

    def fail(self, number, operations=ANY):
        self.failing = (number, operations)

    def heal(self):
        self.failing = (0, frozenset())

    def close(self):
        self.break_off()
        self.unmount()

    # ---- the server

    def serve(self, fd):
        try:
            while not self.over:
                if not select.select([fd], [], [], 0.05)[0]:
                    continue
                request = os.read(fd, 1 << 20)
                self.answers.wait()  # a frozen call does not return, even if the caller is killed
                length, opcode, unique, node = struct.unpack_from("<IIQQ", request)
                if opcode in (FORGET, BATCH_FORGET, INTERRUPT):
                    continue
                self.calls += 1
                try:
                    if opcode in self.failing[1]:
                        raise OSError(self.failing[0], "requested by the test")
                    body = self.answer(opcode, node, request[40:length])
                    head = struct.pack("<IiQ", 16 + len(body), 0, unique)
                except OSError as why:
                    body, head = b"", struct.pack("<IiQ", 16, -(why.errno or errno.EIO), unique)
                if self.over:
                    break
                try:
                    os.write(fd, head + body)
                except OSError as why:
                    if why.errno != errno.ENOENT:  # the caller was killed
                        raise
        except OSError:
            pass  # unmounted or interrupted
        finally:
            for handle in self.handles.values():
                os.close(handle)
            self.handles = {}
            os.close(fd)

    def child(self, node, name):
        return os.path.join(self.paths[node], os.fsdecode(name))

    def lasting(self):
        return struct.pack("<Q", int(self.keeps_s)), struct.pack("<I", int(self.keeps_s % 1 * 1e9))

    def attributes(self, s):
        times = [int(t) + self.skew_s for t in (s.st_atime, s.st_mtime, s.st_ctime)]
        parts = [t % 10**9 for t in (s.st_atime_ns, s.st_mtime_ns, s.st_ctime_ns)]
        return struct.pack("<QQQQQQIIIIIIIIII", s.st_ino, s.st_size, s.st_blocks, *times, *parts, s.st_mode, s.st_nlink,
                           s.st_uid, s.st_gid, 0, 4096, 0)

    def entry(self, path):
        s = os.lstat(path)
        node = self.nodes.setdefault(s.st_ino, len(self.nodes) + 2)
        self.paths[node] = path
        seconds, parts = self.lasting()
        return struct.pack("<QQ", node, 0) + seconds + seconds + parts + parts + self.attributes(s)

    def attr_out(self, s):
        seconds, parts = self.lasting()
        return seconds + parts + struct.pack("<I", 0) + self.attributes(s)

    def opened(self, handle):
        self.handles[handle] = handle
        return struct.pack("<QII", handle, 0, 0)

    def answer(self, opcode, node, body):
        if opcode == INIT:
            return struct.pack("<IIIIHHIIHHI", 7, 31, 1 << 16, 0, 16, 12, 1 << 17, 1, 32, 0, 0) + bytes(28)
        if opcode == LOOKUP:
            return self.entry(self.child(node, body[:-1]))
        if opcode == GETATTR:
            return self.attr_out(os.lstat(self.paths[node]))
        if opcode == SETATTR:
            valid, _, _, size = struct.unpack_from("<IIQQ", body)
            mode, = struct.unpack_from("<I", body, 68)
            if valid & 1:
                os.chmod(self.paths[node], stat.S_IMODE(mode))
            if valid & 8:
                os.truncate(self.paths[node], size)
            return self.attr_out(os.lstat(self.paths[node]))
        if opcode == MKDIR:
            path = self.child(node, body[8:-1])
            os.mkdir(path, struct.unpack_from("<I", body)[0] & 0o7777)
            return self.entry(path)
        if opcode in (UNLINK, RMDIR):
            (os.unlink if opcode == UNLINK else os.rmdir)(self.child(node, body[:-1]))
            return b""
        if opcode in (RENAME, RENAME2):
            skip = 8 if opcode == RENAME else 16
            if opcode == RENAME2 and struct.unpack_from("<I", body, 8)[0] != 0:
                raise OSError(errno.EINVAL, "a share that cannot")
            old, new = body[skip:-1].split(b"\0")
            target = self.child(struct.unpack_from("<Q", body)[0], new)
            os.rename(self.child(node, old), target)
            self.entry(target)
            return b""
        if opcode == OPEN:
            return self.opened(os.open(self.paths[node], struct.unpack_from("<I", body)[0] & ~os.O_CREAT))
        if opcode == CREATE:
            flags, mode = struct.unpack_from("<II", body)
            path = self.child(node, body[16:-1])
            handle = os.open(path, flags | os.O_CREAT, mode)
            return self.entry(path) + self.opened(handle)
        if opcode == READ:
            handle, offset, size = struct.unpack_from("<QQI", body)
            return os.pread(self.handles[handle], size, offset)
        if opcode == WRITE:
            handle, offset, size = struct.unpack_from("<QQI", body)
            return struct.pack("<II", os.pwrite(self.handles[handle], body[40:40 + size], offset), 0)
        if opcode == STATFS:
            s = os.statvfs(self.behind)
            return struct.pack("<QQQQQIIII", s.f_blocks, s.f_bfree, s.f_bavail, s.f_files, s.f_ffree, s.f_bsize, 255,
                               s.f_frsize, 0) + bytes(24)
        if opcode == OPENDIR:
            return self.opened(os.open(self.paths[node], os.O_RDONLY | os.O_DIRECTORY))
        if opcode == READDIR:
            _, offset, size = struct.unpack_from("<QQI", body)
            names = [".", "..", *sorted(os.listdir(self.paths[node]))]
            out = b""
            for place, name in enumerate(names):
                raw = os.fsencode(name)
                one = struct.pack("<QQII", place + 1, place + 1, len(raw), 0) + raw
                one += bytes(-len(one) % 8)
                if place < offset:
                    continue
                if len(out) + len(one) > size:
                    break
                out += one
            return out
        if opcode in (RELEASE, RELEASEDIR):
            os.close(self.handles.pop(struct.unpack_from("<Q", body)[0]))
            return b""
        if opcode in (FSYNC, FSYNCDIR, FLUSH):
            return b""
        raise OSError(errno.ENOSYS, "not needed")
