// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <poll.h>

#include <array>
#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string_view>

#include "base/base.h"
#include "base/fields.h"
#include "base/jobs.h"
#include "base/team.h"

/// Everything outside the process, as ports. Each has a real life (here and in the .cpp files of this room) and a
/// scripted one (`tests/mock/`). Units, word order and frames are converted on this side of the ports.
///
/// Two shapes: PLC and robot pose are *pollable* (the loop waits on their descriptors and never blocks in them); the
/// scanner is *blocking* (it waits for a file and for the disk, so it lives on a worker thread).
namespace slabd::hal {

// ---- clock, service manager ------------------------------------------------------------------------------------

class Clock {
 public:
  virtual ~Clock() = default;
  [[nodiscard]] virtual std::int64_t mono_ns() const = 0;   ///< for every decision
  [[nodiscard]] virtual std::int64_t utime_us() const = 0;  ///< for records only
};
[[nodiscard]] std::unique_ptr<Clock> make_system_clock();

/// systemd's notify protocol; silent when not started by a service manager.
class ServiceNotify {
 public:
  virtual ~ServiceNotify() = default;
  virtual void ready() = 0;
  virtual void watchdog() = 0;
  virtual void status(std::string_view line) = 0;
  virtual void stopping() = 0;
};
[[nodiscard]] std::unique_ptr<ServiceNotify> make_systemd_notify();

// ---- PLC -------------------------------------------------------------------------------------------------------

inline constexpr std::size_t kPlcPollFds = limits::kModbusClientsMax + 1;

/// What happened on the way to the PLC since the start.
struct PlcLinkCounters {
  std::uint64_t connections = 0;   ///< accepted (server), opened (client, serial line)
  std::uint64_t frames = 0;        ///< whole requests served, or answers received (client)
  std::uint64_t exceptions = 0;    ///< refusals given, or received (client)
  std::uint64_t not_allowed = 0;   ///< connections from an address that may not connect
  std::uint64_t read_only = 0;     ///< writes from an address that may only read
  std::uint64_t displaced = 0;     ///< connections closed to make room for a newer one
  std::uint64_t malformed = 0;     ///< bytes that are no Modbus: wrong protocol, length or checksum
  std::uint64_t late = 0;          ///< frames not complete in time; questions without an answer (client)
  std::uint64_t idle = 0;          ///< connections closed because nobody spoke
  std::uint64_t unsent = 0;        ///< replies that the peer did not take
  std::int64_t last_frame_ns = 0;  ///< when the last of `frames` came, 0: never
};
/// The counters themselves.
SLABD_FIELDS(PlcLinkCounters, connections, frames, exceptions, not_allowed, read_only, displaced, malformed, late, idle,
             unsent);

using PlcNoteText = FixedString<limits::kErrorTextBytes>;

/// The PLC, whoever of the two moves the bytes.
class PlcPort {
 public:
  virtual ~PlcPort() = default;
  /// Fills `fds` (at least kPlcPollFds) with what to wait for; returns how many.
  [[nodiscard]] virtual std::size_t poll_fds(std::span<pollfd> fds) = 0;
  /// Serves what is ready without blocking. True: the PLC has written, `inputs` is its image after that one write;
  /// call again until false, so that no write is skipped. Reads are answered from the last published outputs.
  [[nodiscard]] virtual bool next(std::int64_t mono_ns, PlcInputs& inputs) = 0;
  /// Replaces what the PLC reads, as one consistent image.
  virtual void publish(const PlcOutputs& outputs) = 0;
  /// Connections now open.
  [[nodiscard]] virtual std::size_t clients() const = 0;
  [[nodiscard]] virtual const PlcLinkCounters& counters() const = 0;
  /// Why there is no link, with the cure; empty while there is one, and always for a server, which waits.
  [[nodiscard]] virtual std::string_view trouble() const = 0;
  /// A line for the log about what went wrong on the wire since the last one: at once for the first, then at most one
  /// in ten seconds, so that nobody on the network can fill the disk. False: nothing to say.
  [[nodiscard]] virtual bool next_note(std::int64_t mono_ns, PlcNoteText& text) = 0;
  /// HR 0..39 as the PLC last wrote them.
  [[nodiscard]] virtual std::span<const std::uint16_t> holding() const = 0;
};

enum class WordOrder : std::uint8_t { abcd, cdab };

/// Who moves the bytes of register map 1.0. What they mean is the same in all three.
enum class PlcRole : std::uint8_t {
  server,  ///< Modbus/TCP: the PLC connects to slabd
  client,  ///< Modbus/TCP: slabd connects to the PLC, whose memory holds both halves
  rtu,     ///< serial line: the PLC is the master, slabd a slave
};
inline constexpr std::array<std::string_view, 3> kPlcRoles = {"server", "client", "rtu"};

enum class SerialParity : std::uint8_t { even, odd, none };

/// All of slabd's registers in one request; and the fewest that a client can be set to ask for at once.
inline constexpr std::uint16_t kPlcRegistersMax = 110;
inline constexpr std::uint16_t kPlcRegistersMin = 16;

struct PlcSettings {
  PlcRole role = PlcRole::server;
  std::uint8_t unit_id = 1;  ///< slabd's own (server, rtu), or the PLC's (client)
  WordOrder word_order = WordOrder::abcd;

  FixedString<64> host = "127.0.0.1";  ///< IPv4: where the server listens, or of the PLC (client)
  std::uint16_t port = 1502;           ///< server: 0 = any free port (tests); `bound_port` tells which

  // server
  /// CIDR blocks that may connect; IPv4, network byte order folded into host integers. None: this computer only.
  struct Network {
    std::uint32_t address = 0;
    std::uint32_t mask = 0;
  };
  FixedVector<Network, 16> allow;
  FixedVector<Network, 16> read_only;  ///< who of them may only read: displays

  // client: the same two memories in the PLC
  std::uint16_t command_base = 0;                  ///< holding register of the PLC that is HR 0
  std::uint16_t status_base = 1000;                ///< holding register of the PLC that is IR 0
  bool read_write = false;                         ///< use FC 23 to write and read at once
  std::uint16_t registers_max = kPlcRegistersMax;  ///< of one request
  bool keep_connection = true;                     ///< false: a new one for each request
  std::int64_t poll_ns = 50'000'000;
  std::int64_t timeout_ns = 500'000'000;  ///< of connecting, and of one answer

  // serial line
  PathText device;
  std::uint32_t baud = 115'200;
  SerialParity parity = SerialParity::even;
  std::uint8_t stop_bits = 1;
  bool rs485 = false;  ///< the kernel's driver switches the direction (TIOCSRS485)
};

/// The port that `settings.role` asks for. config: what is wrong with the settings, or a listening address in use; a
/// PLC that does not answer and a serial line that is not there are troubles of the port, not errors.
[[nodiscard]] Result<std::unique_ptr<PlcPort>> make_plc_port(const PlcSettings& settings);

class ModbusServer : public PlcPort {
 public:
  [[nodiscard]] virtual std::uint16_t bound_port() const = 0;
};
/// Opens the listening socket. config on a bad address, a port in use (the text names it).
[[nodiscard]] Result<std::unique_ptr<ModbusServer>> make_modbus_server(const PlcSettings& settings);
/// Starts the thread that talks to the PLC. config on a bad address or registers that overlap.
[[nodiscard]] Result<std::unique_ptr<PlcPort>> make_modbus_client(const PlcSettings& settings);
/// Opens the line, now or when it is there. config on a unit id or a speed that does not exist.
[[nodiscard]] Result<std::unique_ptr<PlcPort>> make_modbus_rtu(const PlcSettings& settings);

/// "10.0.0.0/8" -> Network.
[[nodiscard]] Result<PlcSettings::Network> parse_network(std::string_view cidr);
/// The speeds a serial line may have.
inline constexpr std::array<std::uint32_t, 8> kSerialBauds = {1'200,  2'400,  4'800,  9'600,
                                                              19'200, 38'400, 57'600, 115'200};

// ---- robot pose ------------------------------------------------------------------------------------------------

/// Each thing that can be wrong with what arrives has a counter of its own.
struct PoseLinkCounters {
  std::uint64_t accepted = 0;
  // Datagrams that are no pose for us.
  std::uint64_t foreign = 0;       ///< other channel, other magic, other length or fingerprint
  std::uint64_t other_type = 0;    ///< of `foreign`: on the right channel, and of another type than the configured one
  std::uint64_t wrong_sender = 0;  ///< from an address outside [pose] senders, or not of this computer
  // Poses that are refused. `malformed` is the sum of the three below it.
  std::uint64_t malformed = 0;
  std::uint64_t not_finite = 0;        ///< NaN or infinity
  std::uint64_t not_unit = 0;          ///< the quaternion is not one of unit length
  std::uint64_t out_of_reach = 0;      ///< no robot of this line reaches there
  std::uint64_t second_publisher = 0;  ///< while two publish, neither is believed
  std::uint64_t repeated = 0;          ///< the same message again
  std::uint64_t time_back = 0;         ///< the sender's clock stands still or runs backwards
  std::uint64_t time_unit = 0;         ///< the sender's clock counts in nanoseconds or milliseconds
  std::uint64_t jumps = 0;             ///< faster than any robot, and the next pose does not confirm it
  // Accepted, but the settled window begins again.
  std::uint64_t gaps = 0;  ///< breaks in the numbering ...
  std::uint64_t lost = 0;  ///< ... and the messages that are missing in them
};
SLABD_FIELDS(PoseLinkCounters, accepted, foreign, other_type, wrong_sender, malformed, not_finite, not_unit,
             out_of_reach, second_publisher, repeated, time_back, time_unit, jumps, gaps, lost);

using PoseNoteText = FixedString<limits::kErrorTextBytes>;

class PosePort {
 public:
  virtual ~PosePort() = default;
  /// -1 while there is no link.
  [[nodiscard]] virtual int fd() const = 0;
  /// Next well-formed pose, converted to mm; false when none is waiting. Never blocks; retries a missing interface
  /// once a second.
  [[nodiscard]] virtual bool next(std::int64_t mono_ns, PoseSample& sample) = 0;
  [[nodiscard]] virtual const PoseLinkCounters& counters() const = 0;
  /// Why there is no link (interface down, no address, no route) with the cure; empty while there is one.
  [[nodiscard]] virtual std::string_view trouble() const = 0;
  /// Why poses that arrive are not believed, with who sent them; empty when none was refused within two seconds.
  [[nodiscard]] virtual std::string_view refusal(std::int64_t mono_ns) const {
    static_cast<void>(mono_ns);
    return {};
  }
  /// A line for the log about what was refused since the last one: at once for the first, then at most one in ten
  /// seconds. False: nothing to say.
  [[nodiscard]] virtual bool next_note(std::int64_t mono_ns, PoseNoteText& text) {
    static_cast<void>(mono_ns);
    static_cast<void>(text);
    return false;
  }
};

/// What the robot's bridge publishes.
enum class PoseType : std::uint8_t {
  flange_pose,      ///< slabd.flange_pose_t
  rigid_transform,  ///< bot_core.rigid_transform_t: no number, no frame, no flags; only its clock orders it
};
inline constexpr std::array<std::string_view, 2> kPoseTypes = {"slabd.flange_pose_t", "bot_core.rigid_transform_t"};

struct LcmSettings {
  FixedString<128> url = "udpm://239.255.76.67:7667?ttl=0";
  FixedString<63> channel = "FLANGE_POSE";
  FixedString<32> interface;  ///< name or IPv4 address; empty = the kernel's route
  PoseType type = PoseType::flange_pose;
  FixedVector<PlcSettings::Network, 16> senders;  ///< who may publish; none: everybody whom the interface lets in
};
/// Checks url, channel and interface name; the link itself is opened (and re-opened) by next().
[[nodiscard]] Result<std::unique_ptr<PosePort>> make_lcm_pose_port(const LcmSettings& settings);

/// The bounded LC02 reader (hal/robot/lcm_wire.h): one datagram in, one pose out. No heap, never reads past
/// `datagram`. False: not a pose on `channel`; `counters` says why. `sample.arrival_ns` is left for the caller.
[[nodiscard]] bool decode_pose_datagram(std::span<const std::byte> datagram, std::string_view channel,
                                        PoseSample& sample, PoseLinkCounters& counters,
                                        PoseType type = PoseType::flange_pose);

// ---- scans -----------------------------------------------------------------------------------------------------

enum class LengthUnit : std::uint8_t { mm, m, um };

/// How a scan is written. Read is more: see `read_scan`.
enum class ScanFormat : std::uint8_t {
  ply,             ///< binary, little-endian
  ply_ascii,       ///< text
  ply_be,          ///< binary, big-endian
  pcd,             ///< PCD 0.7, DATA binary
  pcd_ascii,       ///< DATA ascii
  pcd_compressed,  ///< DATA binary_compressed
  xyz,             ///< lines of "x y z"; cannot say that a scan is organised
  csv,             ///< as xyz, with commas below a line "x,y,z"
};
inline constexpr std::array kScanFormats = {ScanFormat::ply, ScanFormat::ply_ascii, ScanFormat::ply_be,
                                            ScanFormat::pcd, ScanFormat::pcd_ascii, ScanFormat::pcd_compressed,
                                            ScanFormat::xyz, ScanFormat::csv};
/// "ply-ascii"; the extension with which the format is read back, without a dot: "ply".
[[nodiscard]] std::string_view name(ScanFormat format);
[[nodiscard]] std::string_view extension(ScanFormat format);
/// By its name, or by a path's extension (the first of the list above that has it; .asc and .txt are xyz).
[[nodiscard]] std::optional<ScanFormat> scan_format_named(std::string_view name);
[[nodiscard]] std::optional<ScanFormat> scan_format_of(std::string_view path);

/// Which columns of a table hold x, y and z: names that the table gives to its columns, or numbers from 1.
struct TableColumns {
  std::array<FixedString<40>, 3> xyz;
  [[nodiscard]] bool empty() const { return xyz[0].empty(); }
};
/// "PosX,PosY,PosZ" or "2,3,4". config: not three of them.
[[nodiscard]] Result<TableColumns> parse_table_columns(std::string_view text);
/// How scan files are written, as far as they do not say it themselves: the unit of their coordinates, and the columns
/// of their tables.
struct ScanForm {
  LengthUnit unit = LengthUnit::mm;
  TableColumns columns;
  ScanForm() = default;
  /// Implicit, because a unit alone is the usual form.
  // NOLINTNEXTLINE(google-explicit-constructor)
  ScanForm(LengthUnit length_unit, const TableColumns& table_columns = {})
      : unit(length_unit), columns(table_columns) {}
};
/// Columns of a table that does not name them: x, y, z and a dozen values of each point. More of them are heights.
inline constexpr std::size_t kTableColumnsMax = 24;

/// Reads a scan file into `xyz` (3 floats a point), converted to mm, in the frame the file has: the scanner's. The
/// extension, in any case, says what it is:
///   .ply                  ascii, binary little- or big-endian 1.0; x, y, z float or double; other properties and
///                         elements, also with lists, are stepped over; `comment organized width W height H`
///   .pcd                  0.6 and 0.7, ascii, binary, binary_compressed; x, y, z of 4 or 8 bytes; other fields are
///                         stepped over; organised when HEIGHT > 1; VIEWPOINT is not applied
///   .xyz .asc .txt .csv   lines of numbers between blanks, tabs, commas or semicolons, `#` and `//` comments, perhaps
///                         the number of points in a first line, column names in a first line or in a comment above
///                         the points; missing values are missing points. x, y, z are the columns of these names, else
///                         of `form.columns`, else, without names, the first three of at most kTableColumnsMax
/// Lines end with LF, CR LF or CR; UTF-8's byte-order mark is stepped over, UTF-16 refused.
/// The unit is `form.unit`; a file whose comments say another one is refused. A point that is not finite in x, y and z
/// becomes NaN in all three. The file must be a regular one (links are not followed) and end where its header says, but
/// for zeros of up to 64 kB (PCL's writer) or one line end behind binary data.
/// Counts are compared with the file's size and with `xyz` before a point is read; lines of a table, which announces
/// nothing, are counted as they come. frame_incomplete: the text names file and byte, or line and column, and what was
/// expected; too_few_points: no points at all. After an error `xyz` holds nothing of use. No heap; 320 kB of stack.
[[nodiscard]] Result<ScanShape> read_scan(const char* path, const ScanForm& form, std::span<float> xyz);
/// The same; a team of two reads points that are records (binary, without lists) at once.
[[nodiscard]] Result<ScanShape> read_scan(const char* path, const ScanForm& form, std::span<float> xyz, Team& team);
/// The same with every digit of the file, for clouds that are analysed and not inspected.
[[nodiscard]] Result<ScanShape> read_scan(const char* path, const ScanForm& form, std::span<double> xyz);

/// CRC-32C (hal/system/crc32c.h) of points (x, y, z in mm) as they were read, in the order of the file, missing ones
/// included: each number as the four bytes of its float32, little-endian; of a missing point three times 00 00 C0 7F,
/// whatever NaN the file had. `before`: of the points in front of these. docs/QUALITY.md has it in ten lines of Python.
[[nodiscard]] std::uint32_t points_crc32c(std::span<const float> xyz, std::uint32_t before = 0);

struct ScanChecksum {
  ScanShape shape;
  std::uint32_t crc32c = 0;  ///< what points_crc32c() gives for the points that read_scan() gives
};
/// Reads a scan whose points are records (ScanShape::in_records) piece by piece. frame_incomplete: it is none, or as
/// read_scan(). No heap; 320 kB of stack; 5 ms for five million points in the page cache.
[[nodiscard]] Result<ScanChecksum> read_scan_checksum(const char* path, LengthUnit unit);

/// What a comment of the file says of its origin; by default nothing.
struct WrittenBy {
  bool emulator = false;  ///< "emulated by slabctl simulate"
  int block = 0;          ///< ", block 3"; 0: not said
};
/// Writes a scan (for the emulator and tests) of float32 points, text with as many digits as bring the same bits back.
/// width * height > 0: organised, as far as the format can say so. config: the shape does not fit;
/// store_full, internal: nothing is left of the file. Uses the heap.
[[nodiscard]] Status write_scan(const char* path, ScanFormat format, std::span<const float> xyz, std::size_t width,
                                std::size_t height, WrittenBy by = WrittenBy{});
/// The same as binary little-endian PLY, without the heap.
[[nodiscard]] Status write_ply(const char* path, std::span<const float> xyz, std::size_t width, std::size_t height,
                               WrittenBy by = WrittenBy{});

/// A scan whose points lie in their buffer, complete and not durable yet: nothing writes to the buffer any more, and
/// the scan may still fail. Its `path` is where it is going to lie.
using ScanDecoded = std::function<void(const AcquiredScan&)>;

using ScannerText = FixedString<limits::kErrorTextBytes>;

class ScannerPort {
 public:
  virtual ~ScannerPort() = default;
  /// Requests one scan and returns when it is decoded into `xyz` and durable in the spool. Calls `decoded` in between,
  /// on this thread: syncing 60 MB takes longer than measuring them, so who wants may begin. Blocks up to the timeout;
  /// returns interrupted soon after `cancel` becomes true. scanner_offline, trigger_timeout, frame_incomplete,
  /// too_few_points (fewer finite ones than the request needs), store_full, journal_write (the spool cannot be
  /// written); after an error nothing is left in the spool and `xyz` holds nothing of use.
  [[nodiscard]] virtual Result<AcquiredScan> acquire(const ScanRequest& request, std::span<float> xyz,
                                                     const std::atomic<bool>& cancel, const ScanDecoded& decoded) = 0;
  /// Between scans: clear away what does not belong there. Returns quickly.
  virtual void idle() = 0;
  [[nodiscard]] virtual bool online() const = 0;                ///< callable from any thread
  [[nodiscard]] virtual std::uint64_t stray_files() const = 0;  ///< moved aside since start; any thread
  /// Why it is not online, and what was wrong last; empty: nothing. Any thread.
  [[nodiscard]] virtual ScannerText trouble() const { return {}; }
  /// A call into the operating system has not come back for seconds (a network share that hangs): neither acquire() nor
  /// idle() returns before it does, and nobody can make it. Any thread.
  [[nodiscard]] virtual bool hangs() const { return false; }
  /// Of hangs(): the scan is there, and it is the spool's disk that does not take it.
  [[nodiscard]] virtual bool spool_hangs() const { return false; }
  /// Another daemon uses this scanner's folder: the text names folder and daemon. Empty: none does. Any thread.
  [[nodiscard]] virtual ScannerText used_by_another() const { return {}; }
  /// Of the files that were moved aside: deleted again, because there was no more room for them.
  struct Deleted {
    std::uint64_t files = 0;
    std::uint64_t bytes = 0;
  };
  [[nodiscard]] virtual Deleted deleted() const { return {}; }  ///< since start; any thread
  /// What somebody should read of what was moved aside or deleted, oldest first; false: nothing new. One thread.
  [[nodiscard]] virtual bool next_note(ScannerText&) { return false; }
};

/// Who holds the lock of a folder, for others to read: process, computer, configuration.
using LockOwner = FixedString<200>;
[[nodiscard]] LockOwner lock_owner_of_this_process(std::string_view config_path);

/// A folder that one daemon at a time may use: flock(2) on the file `.slabd.lock` in it, which names the owner. The
/// kernel gives it back when the process ends, however it ends. No heap.
class FolderLock {
 public:
  enum class State : std::uint8_t {
    ours,
    anothers,  ///< text(): who
    cannot,    ///< text(): why this file system does not lock, or the file cannot be written
  };
  explicit FolderLock(const LockOwner& owner) : owner_(owner) {}
  FolderLock(const FolderLock&) = delete;
  FolderLock& operator=(const FolderLock&) = delete;
  ~FolderLock();

  /// Takes the lock of the open folder, or keeps it; takes it again if the lock file was deleted or the folder is
  /// another one by now. Never waits for another process.
  State take(int folder_fd);
  /// The same of a folder by its path; the lock is `cannot` if the folder is not there.
  State take(const char* folder);
  [[nodiscard]] const ScannerText& text() const { return text_; }

 private:
  LockOwner owner_;
  int file_ = -1;
  ScannerText text_;
};

struct ScanDropSettings {
  PathText drop_dir;
  /// Who uses the folder alone; empty: it is not locked (tests).
  LockOwner owner;
  bool any_name = false;
  ScanForm form;
  bool make_drop_dir = false;  ///< at the first look, in a folder that is there
  int read_threads = 1;        ///< 2: a helper reads binary scans with the port's own thread
  /// any_name: a scanner that was asked answers within this time, or its request's timeout if that is longer, or not at
  /// all (its own timeouts, a restart of slabd).
  std::int64_t late_answer_ns = 10 * kNsPerS;
  /// What stray/ may hold: thirty full-size scans. What somebody wants to look at is there, and no scanner program that
  /// exports without end fills the disk.
  std::uint64_t stray_bytes_max = 2'000'000'000;
};
/// Touches nothing itself, for drop_dir may lie on a share that hangs. The first idle() or acquire() makes request/,
/// inbox/ and stray/ below drop_dir; while that is not possible (a share not mounted yet) the port is offline, and
/// idle() looks again. config: drop_dir is empty or too long.
[[nodiscard]] Result<std::unique_ptr<ScannerPort>> make_scan_drop(const ScanDropSettings& settings, const Clock& clock);

/// Scans over TCP: slabd listens, the scanner's gateway connects (docs/SCANNER.md).
struct ScanStreamSettings {
  FixedString<64> host = "127.0.0.1";  ///< IPv4
  std::uint16_t port = 1504;           ///< 0 = any free port (tests)
  FixedVector<PlcSettings::Network, 16> allow;
};
class ScanStreamPort : public ScannerPort {
 public:
  [[nodiscard]] virtual std::uint16_t bound_port() const = 0;
};
/// `stray_files` counts data that nobody asked for, damaged scans and connections that were turned away. The spool file
/// is binary PLY in mm whatever unit the sender uses. config: a bad address; one that cannot be listened on now is a
/// trouble, and idle() tries again.
[[nodiscard]] Result<std::unique_ptr<ScanStreamPort>> make_scan_stream(const ScanStreamSettings& settings,
                                                                       const Clock& clock);

enum class ScannerBackend : std::uint8_t { drop, tcp };
inline constexpr std::array<std::string_view, 2> kScannerBackends = {"drop", "tcp"};

// ---- control socket --------------------------------------------------------------------------------------------

inline constexpr std::size_t kControlPollFds = limits::kControlClientsMax + 1;

/// AF_UNIX, one JSON object per line. Requests are answered by the loop with a text made beforehand.
class ControlPort {
 public:
  virtual ~ControlPort() = default;
  [[nodiscard]] virtual std::size_t poll_fds(std::span<pollfd> fds) = 0;
  /// A complete request line; answer it with reply(). False when none is waiting.
  [[nodiscard]] virtual bool next(std::int64_t mono_ns, std::string_view& line) = 0;
  virtual void reply(std::string_view json) = 0;
  /// User id of the process that sent the line next() returned; kNobody when it is not known, or between lines.
  [[nodiscard]] virtual std::uint32_t peer_uid() const = 0;
  static constexpr std::uint32_t kNobody = 0xFFFF'FFFF;  ///< POSIX: (uid_t)-1 is nobody's
};
[[nodiscard]] Result<std::unique_ptr<ControlPort>> make_control_socket(const char* path);

}  // namespace slabd::hal
