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

/// The ports to everything outside the process, implemented in the folders plc, robot, scan and system. `tests/mock/`
/// has scripted ones of PLC, robot and scanner. Implementations convert units, word order and frames.
///
/// There are two kinds of ports. PLC and robot pose are *pollable*: the loop waits on their descriptors and never
/// blocks in them. The scanner is *blocking*: it waits for a file and for the disk, so it runs on a worker thread.
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

/// Counters of the link to the PLC since start.
struct PlcLinkCounters {
  std::uint64_t connections = 0;   ///< accepted (server), opened (client, serial line)
  std::uint64_t frames = 0;        ///< complete requests served, or answers received (client)
  std::uint64_t exceptions = 0;    ///< exception replies sent, or received (client)
  std::uint64_t not_allowed = 0;   ///< connections from an address that may not connect
  std::uint64_t read_only = 0;     ///< writes from an address that may only read
  std::uint64_t displaced = 0;     ///< connections closed to make room for a newer one
  std::uint64_t malformed = 0;     ///< bytes that are not Modbus: wrong protocol, length or checksum
  std::uint64_t late = 0;          ///< frames not complete in time; requests without an answer (client)
  std::uint64_t idle = 0;          ///< connections closed because they were idle
  std::uint64_t unsent = 0;        ///< replies that the peer did not take
  std::int64_t last_frame_ns = 0;  ///< time of the last of `frames`; 0 if there was none
};
/// The counters only, without the time.
SLABD_FIELDS(PlcLinkCounters, connections, frames, exceptions, not_allowed, read_only, displaced, malformed, late, idle,
             unsent);

using PlcNoteText = FixedString<limits::kErrorTextBytes>;

/// The link to the PLC, independent of which side transfers the data.
class PlcPort {
 public:
  virtual ~PlcPort() = default;
  /// Fills `fds` (at least kPlcPollFds) with the descriptors to wait for; returns their number.
  [[nodiscard]] virtual std::size_t poll_fds(std::span<pollfd> fds) = 0;
  /// Serves what is ready without blocking. True if the PLC has written: `inputs` is its image after that one write.
  /// Call it until it returns false, so that no write is skipped. Reads are answered from the last published outputs.
  [[nodiscard]] virtual bool next(std::int64_t mono_ns, PlcInputs& inputs) = 0;
  /// Replaces what the PLC reads, as one consistent image.
  virtual void publish(const PlcOutputs& outputs) = 0;
  /// Number of open connections.
  [[nodiscard]] virtual std::size_t clients() const = 0;
  [[nodiscard]] virtual const PlcLinkCounters& counters() const = 0;
  /// Reason why the link is down, with the remedy. Empty while it is up, and always for a server, which waits.
  [[nodiscard]] virtual std::string_view trouble() const = 0;
  /// A log line about errors on the link since the last one; false if there is none. The first is returned at once,
  /// then at most one in ten seconds, so that a faulty peer cannot fill the disk.
  [[nodiscard]] virtual bool next_note(std::int64_t mono_ns, PlcNoteText& text) = 0;
  /// HR 0..39 as the PLC last wrote them.
  [[nodiscard]] virtual std::span<const std::uint16_t> holding() const = 0;
};

enum class WordOrder : std::uint8_t { abcd, cdab };

/// Transport of register map 1.1. The meaning of the registers is the same in all three roles.
enum class PlcRole : std::uint8_t {
  server,  ///< Modbus/TCP: the PLC connects to slabd
  client,  ///< Modbus/TCP: slabd connects to the PLC, whose memory holds both halves
  rtu,     ///< serial line: the PLC is the master, slabd a slave
};
inline constexpr std::array<std::string_view, 3> kPlcRoles = {"server", "client", "rtu"};

enum class SerialParity : std::uint8_t { even, odd, none };

/// Largest and smallest limit for the registers of one request of the client. 110 is the number of slabd's registers.
inline constexpr std::uint16_t kPlcRegistersMax = 110;
inline constexpr std::uint16_t kPlcRegistersMin = 16;

struct PlcSettings {
  PlcRole role = PlcRole::server;
  std::uint8_t unit_id = 1;  ///< slabd's own (server, rtu), or that of the PLC (client)
  WordOrder word_order = WordOrder::abcd;

  bool gauges = false;  ///< a gauge's source is the PLC: the client also reads HR 40..74

  FixedString<64> host = "127.0.0.1";  ///< IPv4 address to listen on (server), or of the PLC (client)
  std::uint16_t port = 1502;           ///< server: 0 = any free port (tests), returned by `bound_port`

  // server
  /// CIDR blocks that may connect; IPv4, as integers in host order. If empty, only this computer may connect.
  struct Network {
    std::uint32_t address = 0;
    std::uint32_t mask = 0;
  };
  FixedVector<Network, 16> allow;
  FixedVector<Network, 16> read_only;  ///< addresses that may only read: displays

  // client: the PLC's memory holds both register ranges
  std::uint16_t command_base = 0;                  ///< the PLC's holding register for HR 0
  std::uint16_t status_base = 1000;                ///< the PLC's holding register for IR 0
  bool read_write = false;                         ///< use FC 23 to write and read in one request
  std::uint16_t registers_max = kPlcRegistersMax;  ///< limit per request
  bool keep_connection = true;                     ///< false: a new connection for each request
  std::int64_t poll_ns = 50'000'000;
  std::int64_t timeout_ns = 500'000'000;  ///< for connecting, and for one answer

  // serial line
  PathText device;
  std::uint32_t baud = 115'200;
  SerialParity parity = SerialParity::even;
  std::uint8_t stop_bits = 1;
  bool rs485 = false;  ///< the kernel's driver switches the direction (TIOCSRS485)
};

/// Creates the port for `settings.role`. config if the settings are wrong or a listening address is in use. A PLC that
/// does not answer or a missing serial device is reported by trouble(), not as an error.
[[nodiscard]] Result<std::unique_ptr<PlcPort>> make_plc_port(const PlcSettings& settings);

class ModbusServer : public PlcPort {
 public:
  [[nodiscard]] virtual std::uint16_t bound_port() const = 0;
};
/// Opens the listening socket. config if the address is wrong or the port is in use (the text names it).
[[nodiscard]] Result<std::unique_ptr<ModbusServer>> make_modbus_server(const PlcSettings& settings);
/// Starts the thread that communicates with the PLC. config if the address is wrong or the registers overlap.
[[nodiscard]] Result<std::unique_ptr<PlcPort>> make_modbus_client(const PlcSettings& settings);
/// Opens the serial line, now or as soon as the device exists. config if the unit id or the speed is not valid.
[[nodiscard]] Result<std::unique_ptr<PlcPort>> make_modbus_rtu(const PlcSettings& settings);

/// "10.0.0.0/8" -> Network.
[[nodiscard]] Result<PlcSettings::Network> parse_network(std::string_view cidr);
/// Valid speeds of a serial line.
inline constexpr std::array<std::uint32_t, 8> kSerialBauds = {1'200,  2'400,  4'800,  9'600,
                                                              19'200, 38'400, 57'600, 115'200};

// ---- robot pose ------------------------------------------------------------------------------------------------

/// Counters of the link to the robot's bridge, one for each kind of error.
struct PoseLinkCounters {
  std::uint64_t accepted = 0;
  // Datagrams that are not poses for this channel.
  std::uint64_t foreign = 0;       ///< other channel, other magic, other length or fingerprint
  std::uint64_t other_type = 0;    ///< part of `foreign`: on the right channel, but not of the configured type
  std::uint64_t wrong_sender = 0;  ///< from an address outside [pose] senders, or not from this computer
  // Rejected poses. `malformed` is the sum of the three counters below it.
  std::uint64_t malformed = 0;
  std::uint64_t not_finite = 0;        ///< NaN or infinity
  std::uint64_t not_unit = 0;          ///< the quaternion does not have unit length
  std::uint64_t out_of_reach = 0;      ///< beyond the reach of any robot of this line
  std::uint64_t second_publisher = 0;  ///< while two senders publish, poses of both are rejected
  std::uint64_t repeated = 0;          ///< the same message received again
  std::uint64_t time_back = 0;         ///< the sender's clock does not advance or goes backwards
  std::uint64_t time_unit = 0;         ///< the sender's clock counts in nanoseconds or milliseconds
  std::uint64_t jumps = 0;             ///< faster than any robot can move, and not confirmed by the next pose
  // Accepted, but the settled window restarts.
  std::uint64_t gaps = 0;  ///< gaps in the message numbers
  std::uint64_t lost = 0;  ///< messages missing in these gaps
};
SLABD_FIELDS(PoseLinkCounters, accepted, foreign, other_type, wrong_sender, malformed, not_finite, not_unit,
             out_of_reach, second_publisher, repeated, time_back, time_unit, jumps, gaps, lost);

using PoseNoteText = FixedString<limits::kErrorTextBytes>;

class PosePort {
 public:
  virtual ~PosePort() = default;
  /// -1 while the link is down.
  [[nodiscard]] virtual int fd() const = 0;
  /// Next well-formed pose, converted to mm; false when none is waiting. Never blocks; retries a missing interface
  /// once a second.
  [[nodiscard]] virtual bool next(std::int64_t mono_ns, PoseSample& sample) = 0;
  [[nodiscard]] virtual const PoseLinkCounters& counters() const = 0;
  /// Reason why the link is down (interface down, no address, no route), with the remedy; empty while it is up.
  [[nodiscard]] virtual std::string_view trouble() const = 0;
  /// Reason why received poses are rejected, with their sender; empty if none was rejected within two seconds.
  [[nodiscard]] virtual std::string_view refusal(std::int64_t mono_ns) const {
    static_cast<void>(mono_ns);
    return {};
  }
  /// A log line about poses rejected since the last one; false if there is none. The first is returned at once, then at
  /// most one in ten seconds.
  [[nodiscard]] virtual bool next_note(std::int64_t mono_ns, PoseNoteText& text) {
    static_cast<void>(mono_ns);
    static_cast<void>(text);
    return false;
  }
};

/// Message type that the robot's bridge publishes.
enum class PoseType : std::uint8_t {
  flange_pose,      ///< slabd.flange_pose_t
  rigid_transform,  ///< bot_core.rigid_transform_t: without number, frame and flags; ordered only by its clock
};
inline constexpr std::array<std::string_view, 2> kPoseTypes = {"slabd.flange_pose_t", "bot_core.rigid_transform_t"};

struct LcmSettings {
  FixedString<128> url = "udpm://239.255.76.67:7667?ttl=0";
  FixedString<63> channel = "FLANGE_POSE";
  FixedString<32> interface;  ///< name or IPv4 address; empty = the kernel's route
  PoseType type = PoseType::flange_pose;
  FixedVector<PlcSettings::Network, 16> senders;  ///< addresses that may publish; if empty, all that reach the
                                                  ///< interface
};
/// Checks url, channel and interface name; next() opens and reopens the link.
[[nodiscard]] Result<std::unique_ptr<PosePort>> make_lcm_pose_port(const LcmSettings& settings);

/// Decodes one datagram into one pose with the bounded LC02 reader (hal/robot/lcm_wire.h). False if it is not a pose on
/// `channel`; `counters` counts the reason. Uses no heap, never reads past `datagram`. The caller sets
/// `sample.arrival_ns`.
[[nodiscard]] bool decode_pose_datagram(std::span<const std::byte> datagram, std::string_view channel,
                                        PoseSample& sample, PoseLinkCounters& counters,
                                        PoseType type = PoseType::flange_pose);

// ---- scans -----------------------------------------------------------------------------------------------------

enum class LengthUnit : std::uint8_t { mm, m, um };

/// Formats of write_scan(). `read_scan` reads more.
enum class ScanFormat : std::uint8_t {
  ply,             ///< binary, little-endian
  ply_ascii,       ///< text
  ply_be,          ///< binary, big-endian
  pcd,             ///< PCD 0.7, DATA binary
  pcd_ascii,       ///< DATA ascii
  pcd_compressed,  ///< DATA binary_compressed
  xyz,             ///< lines of "x y z"; cannot store that a scan is organised
  csv,             ///< as xyz, with commas, below a line "x,y,z"
};
inline constexpr std::array kScanFormats = {ScanFormat::ply, ScanFormat::ply_ascii, ScanFormat::ply_be,
                                            ScanFormat::pcd, ScanFormat::pcd_ascii, ScanFormat::pcd_compressed,
                                            ScanFormat::xyz, ScanFormat::csv};
/// Name of the format, as "ply-ascii"; extension from which it is read back, without a dot: "ply".
[[nodiscard]] std::string_view name(ScanFormat format);
[[nodiscard]] std::string_view extension(ScanFormat format);
/// Format by its name, or by a path's extension (the first of the list above that has it; .asc and .txt are xyz).
[[nodiscard]] std::optional<ScanFormat> scan_format_named(std::string_view name);
[[nodiscard]] std::optional<ScanFormat> scan_format_of(std::string_view path);

/// Columns of a table that hold x, y and z: names from the table's header, or numbers from 1.
struct TableColumns {
  std::array<FixedString<40>, 3> xyz;
  [[nodiscard]] bool empty() const { return xyz[0].empty(); }
};
/// Parses "PosX,PosY,PosZ" or "2,3,4". config if it does not contain three columns.
[[nodiscard]] Result<TableColumns> parse_table_columns(std::string_view text);
/// How scan files are written, as far as the files do not state it: the unit of their coordinates, and the columns of
/// their tables.
struct ScanForm {
  LengthUnit unit = LengthUnit::mm;
  TableColumns columns;
  ScanForm() = default;
  /// Implicit, because a unit alone is the usual form.
  // NOLINTNEXTLINE(google-explicit-constructor)
  ScanForm(LengthUnit length_unit, const TableColumns& table_columns = {})
      : unit(length_unit), columns(table_columns) {}
};
/// Largest number of columns in a table without names: x, y, z and a dozen values of each point. A wider table is a
/// grid of heights.
inline constexpr std::size_t kTableColumnsMax = 24;

/// Reads a scan file into `xyz` (3 floats a point), converted to mm, in the file's frame, which is the scanner's. The
/// extension selects the format, in upper or lower case:
///   .ply                  ascii, binary little- or big-endian 1.0; x, y, z float or double; other properties and
///                         elements, also with lists, are stepped over; `comment organized width W height H`
///   .pcd                  0.6 and 0.7, ascii, binary, binary_compressed; x, y, z of 4 or 8 bytes; other fields are
///                         stepped over; organised when HEIGHT > 1; VIEWPOINT is not applied
///   .xyz .asc .txt .csv   lines of numbers between blanks, tabs, commas or semicolons, `#` and `//` comments, perhaps
///                         the number of points in a first line, column names in a first line or in a comment above
///                         the points; missing values are missing points. x, y, z are the columns of these names, else
///                         of `form.columns`, else, without names, the first three of at most kTableColumnsMax
/// Lines end with LF, CR LF or CR. A UTF-8 byte-order mark is skipped, UTF-16 is rejected.
/// The unit is `form.unit`; a file whose comments state another unit is rejected. A point that is not finite in x, y
/// and z becomes NaN in all three. The file must be a regular file (links are not followed) and end where its header
/// states. Up to 64 kB of zeros (PCL's writer) or one line end may follow binary data. Counts are compared with the
/// file's size and with `xyz` before a point is read; a table announces no count, so its lines are counted while they
/// are read. frame_incomplete: the text names file and byte, or line and column, and the expected content.
/// too_few_points: the file contains no points. After an error the content of `xyz` is undefined. Uses no heap; 320 kB
/// of stack. A packed scan (.slabz, hal/scan/packed.h) is unpacked into memory first, which uses the heap.
[[nodiscard]] Result<ScanShape> read_scan(const char* path, const ScanForm& form, std::span<float> xyz);
/// The same; a team of two reads points that are records (binary, without lists) in parallel.
[[nodiscard]] Result<ScanShape> read_scan(const char* path, const ScanForm& form, std::span<float> xyz, Team& team);
/// The same in double precision, for clouds that are analysed and not inspected.
[[nodiscard]] Result<ScanShape> read_scan(const char* path, const ScanForm& form, std::span<double> xyz);

/// CRC-32C (hal/system/crc32c.h) of points (x, y, z in mm) in the order of the file, missing ones included. Each number
/// counts as the four bytes of its float32, little-endian; a missing point as three times 00 00 C0 7F, whatever NaN the
/// file contains. `before` is the CRC of the preceding points. docs/QUALITY.md has ten lines of Python for it.
[[nodiscard]] std::uint32_t points_crc32c(std::span<const float> xyz, std::uint32_t before = 0);

struct ScanChecksum {
  ScanShape shape;
  std::uint32_t crc32c = 0;  ///< points_crc32c() of the points that read_scan() returns
};
/// Reads a scan whose points are records (ScanShape::in_records) in pieces. frame_incomplete if they are not, or as
/// read_scan(). Uses no heap; 320 kB of stack; 5 ms for five million points in the page cache.
[[nodiscard]] Result<ScanChecksum> read_scan_checksum(const char* path, LengthUnit unit);

/// Origin of the scan, written as a comment into the file; no comment by default.
struct WrittenBy {
  bool emulator = false;                    ///< "emulated by slabctl simulate"
  int block = 0;                            ///< ", block 3"; 0: not written
  double scanner_temperature_c = kNoValue;  ///< "scanner_temperature_c 31.20"; NaN: not written
};
/// Writes a scan (for the emulator and tests) of float32 points; text has enough digits to restore the same bits. If
/// width * height > 0 the scan is organised, if the format can store that. config if the shape does not fit;
/// store_full, internal: the file is removed. Uses the heap.
[[nodiscard]] Status write_scan(const char* path, ScanFormat format, std::span<const float> xyz, std::size_t width,
                                std::size_t height, WrittenBy by = WrittenBy{});
/// The same as binary little-endian PLY, without the heap.
[[nodiscard]] Status write_ply(const char* path, std::span<const float> xyz, std::size_t width, std::size_t height,
                               WrittenBy by = WrittenBy{});

/// Called with a scan that is complete in its buffer but not durable yet. The buffer is not written any more, but the
/// scan may still fail. `path` is where the scan will be stored.
using ScanDecoded = std::function<void(const AcquiredScan&)>;

using ScannerText = FixedString<limits::kErrorTextBytes>;

class ScannerPort {
 public:
  virtual ~ScannerPort() = default;
  /// Requests one scan and returns when it is decoded into `xyz` and durable in the spool. In between it calls
  /// `decoded` on this thread, because syncing 60 MB takes longer than measuring them. Blocks up to the timeout;
  /// returns interrupted soon after `cancel` becomes true. Errors: scanner_offline, trigger_timeout, frame_incomplete,
  /// too_few_points (fewer finite points than requested), store_full, journal_write (the spool cannot be written).
  /// After an error the spool is unchanged and the content of `xyz` is undefined.
  [[nodiscard]] virtual Result<AcquiredScan> acquire(const ScanRequest& request, std::span<float> xyz,
                                                     const std::atomic<bool>& cancel, const ScanDecoded& decoded) = 0;
  /// Housekeeping between scans: removes foreign files. Returns quickly.
  virtual void idle() = 0;
  [[nodiscard]] virtual bool online() const = 0;                ///< callable from any thread
  [[nodiscard]] virtual std::uint64_t stray_files() const = 0;  ///< moved aside since start; any thread
  /// Reason why it is offline, or the last error; empty if there is none. Any thread.
  [[nodiscard]] virtual ScannerText trouble() const { return {}; }
  /// True if a call into the operating system has been blocked for seconds (a network share that hangs). acquire() and
  /// idle() do not return before the call does, and it cannot be interrupted. Any thread.
  [[nodiscard]] virtual bool hangs() const { return false; }
  /// True if hangs() is caused by the spool's disk: the scan has arrived.
  [[nodiscard]] virtual bool spool_hangs() const { return false; }
  /// Names the folder and the other daemon that uses this scanner's folder; empty if none does. Any thread.
  [[nodiscard]] virtual ScannerText used_by_another() const { return {}; }
  /// Files that were moved aside and later deleted for lack of space.
  struct Deleted {
    std::uint64_t files = 0;
    std::uint64_t bytes = 0;
  };
  [[nodiscard]] virtual Deleted deleted() const { return {}; }  ///< since start; any thread
  /// Next message about files moved aside or deleted, oldest first; false if there is none. One thread.
  [[nodiscard]] virtual bool next_note(ScannerText&) { return false; }
};

/// Text that identifies the holder of a folder's lock: process, computer, configuration.
using LockOwner = FixedString<200>;
[[nodiscard]] LockOwner lock_owner_of_this_process(std::string_view config_path);

/// A folder that one daemon at a time may use: flock(2) on the file `.slabd.lock` in it, which names the owner. The
/// kernel releases the lock when the process ends for any reason. No heap.
class FolderLock {
 public:
  enum class State : std::uint8_t {
    ours,
    anothers,  ///< text(): the owner
    cannot,    ///< text(): why this file system does not lock, or why the file cannot be written
  };
  explicit FolderLock(const LockOwner& owner) : owner_(owner) {}
  FolderLock(const FolderLock&) = delete;
  FolderLock& operator=(const FolderLock&) = delete;
  ~FolderLock();

  /// Takes the lock of the open folder, or keeps it. Takes it again if the lock file was deleted or the folder was
  /// replaced. Never waits for another process.
  State take(int folder_fd);
  /// The same for a folder by its path; `cannot` if the folder does not exist.
  State take(const char* folder);
  [[nodiscard]] const ScannerText& text() const { return text_; }

 private:
  LockOwner owner_;
  int file_ = -1;
  ScannerText text_;
};

struct ScanDropSettings {
  PathText drop_dir;
  /// Owner written to the folder's lock file; empty: the folder is not locked (tests).
  LockOwner owner;
  bool any_name = false;
  ScanForm form;
  bool make_drop_dir = false;  ///< at the first look, if the parent folder exists
  int read_threads = 1;        ///< 2: a helper reads binary scans together with the port's own thread
  /// any_name: longest time after a request in which the scanner may still answer it, because of its own timeouts or a
  /// restart of slabd. The request's timeout applies if it is longer.
  std::int64_t late_answer_ns = 10 * kNsPerS;
  /// Largest size of stray/: thirty full-size scans. Enough to inspect them, and a scanner program that exports without
  /// end cannot fill the disk.
  std::uint64_t stray_bytes_max = 2'000'000'000;
};
/// Does not touch the disk itself, because drop_dir may be on a share that hangs. The first idle() or acquire() makes
/// request/, inbox/ and stray/ below drop_dir. While that fails (a share not mounted yet) the port is offline, and
/// idle() retries. config: drop_dir is empty or too long.
[[nodiscard]] Result<std::unique_ptr<ScannerPort>> make_scan_drop(const ScanDropSettings& settings, const Clock& clock);

/// Scans over TCP: slabd listens, the scanner's gateway connects (docs/DELIVERY.md).
struct ScanStreamSettings {
  FixedString<64> host = "127.0.0.1";  ///< IPv4
  std::uint16_t port = 1504;           ///< 0 = any free port (tests)
  FixedVector<PlcSettings::Network, 16> allow;
  std::uint64_t scanner = 0;  ///< scanner_print() of the accepted scanner; scans of others are rejected; 0: any
};
class ScanStreamPort : public ScannerPort {
 public:
  [[nodiscard]] virtual std::uint16_t bound_port() const = 0;
};
/// `stray_files` counts unrequested data, damaged scans and rejected connections. The spool file is binary PLY in mm,
/// whatever unit the sender uses. config if the address is invalid; if it cannot be listened on now, trouble() reports
/// it and idle() retries.
[[nodiscard]] Result<std::unique_ptr<ScanStreamPort>> make_scan_stream(const ScanStreamSettings& settings,
                                                                       const Clock& clock);

enum class ScannerBackend : std::uint8_t { drop, tcp };
inline constexpr std::array<std::string_view, 2> kScannerBackends = {"drop", "tcp"};

// ---- gauges ----------------------------------------------------------------------------------------------------

/// Addresses that may send gauge values over UDP; IPv4.
using GaugeSenders = FixedVector<PlcSettings::Network, 16>;

/// Lines received over UDP since the start.
struct GaugeCounters {
  std::uint64_t accepted = 0;
  std::uint64_t repeated = 0;   ///< the sequence number of the last one
  std::uint64_t unknown = 0;    ///< no gauge of this name has this port
  std::uint64_t malformed = 0;  ///< not "NAME VALUE SEQ SLAB_NO", or a datagram that is too long
  std::uint64_t foreign = 0;    ///< datagrams from other addresses
};

/// Gauges whose values slabd fetches (Modbus instruments) or receives (UDP), on threads of their own. The loop only
/// copies. Gauges of other links have no samples here.
class GaugePort {
 public:
  virtual ~GaugePort() = default;
  /// The newest sample of each gauge, in the order of its settings. Waits for no instrument; any thread.
  virtual void newest(GaugeSamples& out) const = 0;
  /// Reason why an instrument's last request failed; empty if it did not. Any thread.
  [[nodiscard]] virtual ScannerText trouble(std::size_t index) const = 0;
  [[nodiscard]] virtual GaugeCounters counters() const = 0;
  /// A log line about datagrams that were not used, at most one a minute; false if there is none. One thread.
  [[nodiscard]] virtual bool next_note(std::int64_t mono_ns, ScannerText& text) = 0;
};
/// Starts the threads that the links need. config: a UDP port cannot be opened. An instrument that does not answer is
/// reported by trouble(), not as an error.
[[nodiscard]] Result<std::unique_ptr<GaugePort>> make_gauge_port(std::span<const GaugeSettings> gauges,
                                                                 const GaugeSenders& senders, const Clock& clock);

// ---- control socket --------------------------------------------------------------------------------------------

inline constexpr std::size_t kControlPollFds = limits::kControlClientsMax + 1;

/// AF_UNIX, one JSON object per line. The loop answers requests with a prepared text.
class ControlPort {
 public:
  virtual ~ControlPort() = default;
  [[nodiscard]] virtual std::size_t poll_fds(std::span<pollfd> fds) = 0;
  /// A complete request line; answer it with reply(). False when none is waiting.
  [[nodiscard]] virtual bool next(std::int64_t mono_ns, std::string_view& line) = 0;
  virtual void reply(std::string_view json) = 0;
  /// User id of the process that sent the line that next() returned; kUidUnknown if it is unknown, or between lines.
  [[nodiscard]] virtual std::uint32_t peer_uid() const = 0;
  static constexpr std::uint32_t kUidUnknown = 0xFFFF'FFFF;  ///< POSIX: (uid_t)-1 is not a valid user
};
[[nodiscard]] Result<std::unique_ptr<ControlPort>> make_control_socket(const char* path);

}  // namespace slabd::hal
