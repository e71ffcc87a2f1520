// SPDX-License-Identifier: Apache-2.0
#include "hal/scan/packed.h"

#include <sha256.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>
#include <zstd.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <filesystem>
#include <limits>
#include <memory>
#include <vector>

#include "base/hex.h"
#include "hal/scan/packed_points.h"
#include "hal/scan/point_readers.h"
#include "hal/scan/scan_file.h"
#include "hal/scan/scan_window.h"
#include "hal/system/crc32c.h"

// Problem: scans are stored for years, and a wrong bit in one must be found and named. Idea: the file is cut into
// blocks, of points that are predicted (hal/scan/packed_points.h) or of other bytes. Each block is compressed alone. It
// has a checksum of itself and all blocks before it, which finds damage, and one of its original bytes, which finds a
// wrong restoration. SHA-256 of the original ends the archive.
//
//   head    0 magic "\x89SLABZ\r\n"   8 version (2)   10 words of a point   11 words of x, y, z (3)   14 bytes of name
//   (2)
//          16 bytes of original (8)   24 points of a row (4)   28 CRC-32C of head and name   32 name
//   block   0 kind: B bytes, P points, E end   1 rays, 2 missing (PointCoding)   3 zero   4 original bytes (4)
//           8 packed bytes (4)   12 CRC-32C of the original bytes (4)
//          16 CRC-32C of this head and the packed bytes, continued from the CRC before   20 zstd
//   end     a block of kind E with 32 packed bytes: SHA-256 of the original
// Numbers are little-endian.
//
// Invariants: every length is compared with a limit and with the file's size before memory is taken for it. Archive and
// original end together, at the size that the head states.
namespace slabd::hal {
namespace {

constexpr std::array<char, 8> kMagic = {'\x89', 'S', 'L', 'A', 'B', 'Z', '\r', '\n'};
constexpr std::uint16_t kVersion = 1;
constexpr std::size_t kHeadBytes = 32;
constexpr std::size_t kBlockHeadBytes = 20;
/// The part of it before its own checksum.
constexpr std::size_t kBlockFieldsBytes = 16;
constexpr std::size_t kNameBytesMax = 255;
/// Bytes of one block that is not predicted: header, tail, or all of a text file.
constexpr std::size_t kPlainBytesMax = 1U << 20U;
constexpr std::size_t kEndBytes = SHA256_DIGEST_LENGTH;
static_assert(kEndBytes == 32);
/// The planes of one block: the largest size that zstd has to restore.
constexpr std::size_t kPlanesBytesMax = kPackedPointsMax / 8 + kPackedPointsMax * 4 * kPackedWordsMax;
static_assert(kPlanesBytesMax > kPlainBytesMax);
/// Largest size of a packed block: noise that zstd stores as it is, with the frame of each plane.
constexpr std::size_t kPackedBytesMax = kPlanesBytesMax + kPlanesBytesMax / 128 + (1 + 4 * kPackedWordsMax) * 64;

/// Measured on full-size scans (docs/ARCHIVE.md): higher levels take longer and gain less than 3 %.
constexpr int kLevel = 1;

enum class Kind : std::uint8_t { bytes = 'B', points = 'P', end = 'E' };

struct BlockHead {
  Kind kind = Kind::bytes;
  PointCoding coding;
  std::uint32_t original_bytes = 0;
  std::uint32_t packed_bytes = 0;
  std::uint32_t original_crc32c = 0;
  std::uint32_t crc32c = 0;
};

static_assert(std::endian::native == std::endian::little, "numbers are copied as they are");

template <typename T>
void put(std::span<std::byte> bytes, std::size_t at, T value) {
  std::memcpy(&bytes[at], &value, sizeof value);
}
template <typename T>
T get(std::span<const std::byte> bytes, std::size_t at) {
  T value;
  std::memcpy(&value, &bytes[at], sizeof value);
  return value;
}

unsigned long long printed(std::uint64_t number) {
  return number;
}

/// A name of a file that can be made in any folder.
bool is_file_name(std::string_view name) {
  return !name.empty() && name.size() <= kNameBytesMax && name != "." && name != ".." &&
         std::none_of(name.begin(), name.end(), [](char c) { return c == '/' || (c >= 0 && c < ' ') || c == 0x7F; });
}

class Sha256 {
 public:
  Sha256() { SHA256Init(&context_); }
  void add(std::span<const std::byte> bytes) {
    SHA256Update(&context_, static_cast<const std::uint8_t*>(static_cast<const void*>(bytes.data())), bytes.size());
  }
  [[nodiscard]] std::array<std::uint8_t, kEndBytes> digest() {
    std::array<std::uint8_t, kEndBytes> digest{};
    SHA256Final(digest.data(), &context_);
    return digest;
  }

 private:
  SHA256_CTX context_{};
};

/// The file's size; an error if it cannot be packed or unpacked.
Result<std::uint64_t> size_of(int fd, const char* name) {
  struct stat status {};
  if (fstat(fd, &status) != 0) return error(Code::frame_incomplete, "%s: %s", name, errno_text(errno));
  return static_cast<std::uint64_t>(status.st_size);
}

// ---- packing -----------------------------------------------------------------------------------------------------

struct FreeCompressor {
  void operator()(ZSTD_CCtx* context) const { ZSTD_freeCCtx(context); }
};
struct FreeDecompressor {
  void operator()(ZSTD_DCtx* context) const { ZSTD_freeDCtx(context); }
};

/// Points of a file and their place in it; `record.words` is 0 if it has none that can be predicted.
struct PredictedRun {
  PackedRecord record;
  std::uint64_t begin = 0;
  std::uint64_t points = 0;
};

Result<PointRun> find_records(ScanWindow& window, ScanFamily family, LengthUnit unit) {
  return family == ScanFamily::ply ? find_ply_records(window, unit) : find_pcd_records(window, unit);
}

PredictedRun find_run(int fd, const char* name, std::uint64_t file_bytes) {
  const std::optional<ScanFamily> family = scan_family(extension_of(name));
  if (!family || *family == ScanFamily::text || file_bytes == 0) return {};
  // The unit does not matter here; a file that declares one is accepted with that one only.
  for (const LengthUnit unit : {LengthUnit::mm, LengthUnit::m, LengthUnit::um}) {
    ScanWindow window(fd, name, file_bytes);
    const Result<PointRun> found = find_records(window, *family, unit);
    if (!found) continue;
    const PointRecord& record = found.value().record;
    const ScanShape& shape = found.value().shape;
    PredictedRun run;
    if (record.big_endian || record.bytes % 4 != 0 || record.bytes / 4 > kPackedWordsMax) return {};
    for (std::size_t axis = 0; axis < 3; ++axis) {
      if (record.is_double[axis] || record.offset[axis] % 4 != 0) return {};
      run.record.xyz[axis] = static_cast<std::uint8_t>(record.offset[axis] / 4);
    }
    run.record.words = static_cast<std::uint8_t>(record.bytes / 4);
    if (shape.height > 0 && shape.width <= std::numeric_limits<std::uint32_t>::max())
      run.record.row = static_cast<std::uint32_t>(shape.width);
    run.begin = window.offset();
    run.points = shape.points;
    // The header was compared with the file's size.
    if (run.points > (file_bytes - run.begin) / record.bytes) return {};
    return run;
  }
  return {};
}

class Packer {
 public:
  Packer(ScanWindow& window, std::string_view file_name, const PredictedRun& run, const ByteSink& sink)
      : window_(window), file_name_(file_name), run_(run), sink_(sink), planes_(run.record) {}

  Result<PackedScan> pack() {
    if (context_ == nullptr) return error(Code::internal, "%s: zstd has no memory", window_.name());
    PackedScan packed;
    packed.name = file_name_;
    packed.bytes = window_.file_bytes();
    packed.is_predicted = run_.record.words > 0;
    if (Status status = put_head(); !status) return status.error();
    const std::uint64_t record_bytes = run_.record.bytes();
    if (Status status = put_plain(run_.begin); !status) return status.error();
    for (std::uint64_t done = 0; done < run_.points;) {
      const std::uint64_t points = std::min<std::uint64_t>(kPackedPointsMax, run_.points - done);
      if (Status status = put_points(done, points * record_bytes); !status) return status.error();
      done += points;
    }
    if (Status status = put_plain(window_.left()); !status) return status.error();
    const std::array<std::uint8_t, kEndBytes> digest = sha256_.digest();
    packed_.assign(kBlockHeadBytes, std::byte{});
    const auto bytes = std::as_bytes(std::span(digest));
    packed_.insert(packed_.end(), bytes.begin(), bytes.end());
    original_.clear();
    if (Status status = put_block(Kind::end, {}); !status) return status.error();
    packed.sha256 = hex(digest);
    packed.packed_bytes = written_;
    return packed;
  }

 private:
  Status put_head() {
    std::vector<std::byte> head(kHeadBytes + file_name_.size());
    std::memcpy(head.data(), kMagic.data(), kMagic.size());
    put(head, 8, kVersion);
    put(head, 10, run_.record.words);
    std::memcpy(&head[11], run_.record.xyz.data(), run_.record.xyz.size());
    put(head, 14, static_cast<std::uint16_t>(file_name_.size()));
    put(head, 16, window_.file_bytes());
    put(head, 24, run_.record.row);
    std::memcpy(&head[kHeadBytes], file_name_.data(), file_name_.size());
    crc32c_ = crc32c(head);
    put(head, 28, crc32c_);
    return give(head);
  }

  Status give(std::span<const std::byte> bytes) {
    written_ += bytes.size();
    return sink_(bytes);
  }

  /// Passes on packed_, the packed original_ with room for the head in front.
  Status put_block(Kind kind, PointCoding coding) {
    put(packed_, 0, kind);
    put(packed_, 1, coding.rays);
    put(packed_, 2, coding.missing);
    put(packed_, 4, static_cast<std::uint32_t>(original_.size()));
    put(packed_, 8, static_cast<std::uint32_t>(packed_.size() - kBlockHeadBytes));
    put(packed_, 12, crc32c(original_));
    const std::span<const std::byte> block = packed_;
    crc32c_ = crc32c(block.first(kBlockFieldsBytes), crc32c_);
    crc32c_ = crc32c(block.subspan(kBlockHeadBytes), crc32c_);
    put(packed_, kBlockFieldsBytes, crc32c_);
    return give(packed_);
  }

  Status read(std::uint64_t bytes) {
    original_.resize(bytes);
    if (!window_.read(original_.data(), bytes)) return window_.failure();
    sha256_.add(original_);
    packed_.assign(kBlockHeadBytes, std::byte{});
    return success();
  }

  Status compress(std::span<const std::byte> bytes) {
    const std::size_t at = packed_.size();
    packed_.resize(at + ZSTD_compressBound(bytes.size()));
    const std::size_t packed =
        ZSTD_compressCCtx(context_.get(), &packed_[at], packed_.size() - at, bytes.data(), bytes.size(), kLevel);
    if (ZSTD_isError(packed) != 0)
      return error(Code::internal, "%s: zstd: %s", window_.name(), ZSTD_getErrorName(packed));
    packed_.resize(at + packed);
    return success();
  }

  Status put_plain(std::uint64_t bytes) {
    while (bytes > 0) {
      const std::uint64_t piece = std::min<std::uint64_t>(bytes, kPlainBytesMax);
      if (Status status = read(piece); !status) return status;
      if (Status status = compress(original_); !status) return status;
      if (Status status = put_block(Kind::bytes, {}); !status) return status;
      bytes -= piece;
    }
    return success();
  }

  Status put_points(std::uint64_t first, std::uint64_t bytes) {
    if (Status status = read(bytes); !status) return status;
    const PointCoding coding = planes_.split(original_, first);
    for (const std::span<const std::byte> plane : planes_.planes())
      if (Status status = compress(plane); !status) return status;
    return put_block(Kind::points, coding);
  }

  ScanWindow& window_;
  std::string_view file_name_;
  PredictedRun run_;
  const ByteSink& sink_;
  PointPlanes planes_;
  std::unique_ptr<ZSTD_CCtx, FreeCompressor> context_{ZSTD_createCCtx()};
  Sha256 sha256_;
  std::uint32_t crc32c_ = 0;
  std::uint64_t written_ = 0;
  std::vector<std::byte> original_;
  std::vector<std::byte> packed_;
};

// ---- unpacking -----------------------------------------------------------------------------------------------------

struct ArchiveHead {
  PackedScan packed;
  PackedRecord record;
  std::uint32_t crc32c = 0;
};

Error damaged(const ScanWindow& window, std::uint64_t byte, const char* why) {
  return error(Code::frame_incomplete, "%s: byte %llu: %s", window.name(), printed(byte), why);
}

/// True if the layout of a point is one that is written.
bool is_layout(const PackedRecord& record) {
  if (record.words == 0) return record.row == 0 && record.xyz == std::array<std::uint8_t, 3>{};
  const auto [x, y, z] = record.xyz;
  return record.words >= 3 && record.words <= kPackedWordsMax && x < record.words && y < record.words &&
         z < record.words && x != y && y != z && x != z;
}

/// Reads and checks the head at the start of the file.
Result<ArchiveHead> read_head(ScanWindow& window) {
  std::array<std::byte, kHeadBytes + kNameBytesMax> bytes{};
  if (window.file_bytes() > kPackedFileBytesMax + kPackedFileBytesMax / 8)
    return damaged(window, 0, "the archive is larger than any that slabd writes");
  if (!window.read(bytes.data(), kHeadBytes)) return window.failure();
  if (std::memcmp(bytes.data(), kMagic.data(), kMagic.size()) != 0)
    return damaged(window, 0, "not a packed scan of slabd");
  if (const auto version = get<std::uint16_t>(bytes, 8); version != kVersion)
    return error(Code::frame_incomplete, "%s: byte 8: version %u of the format, this slabd reads version %u",
                 window.name(), version, kVersion);
  const std::size_t name_bytes = get<std::uint16_t>(bytes, 14);
  if (name_bytes > kNameBytesMax) return damaged(window, 14, "the stored file name is too long");
  if (!window.read(&bytes[kHeadBytes], name_bytes)) return window.failure();
  const std::span<std::byte> head = std::span(bytes).first(kHeadBytes + name_bytes);

  ArchiveHead read;
  read.crc32c = get<std::uint32_t>(head, 28);
  put(head, 28, std::uint32_t{0});
  if (crc32c(head) != read.crc32c) return damaged(window, 0, "damaged: the checksum of the head is wrong");
  read.packed.name.assign(static_cast<const char*>(static_cast<const void*>(&head[kHeadBytes])), name_bytes);
  read.packed.bytes = get<std::uint64_t>(head, 16);
  read.packed.packed_bytes = window.file_bytes();
  read.record.words = get<std::uint8_t>(head, 10);
  std::memcpy(read.record.xyz.data(), &head[11], read.record.xyz.size());
  read.record.row = get<std::uint32_t>(head, 24);
  read.packed.is_predicted = read.record.words > 0;
  if (!is_layout(read.record)) return damaged(window, 10, "a layout of points that slabd does not write");
  if (!is_file_name(read.packed.name)) return damaged(window, kHeadBytes, "the stored name is not a file name");
  if (read.packed.bytes > kPackedFileBytesMax) return damaged(window, 16, "the original is larger than allowed");
  return read;
}

class Unpacker {
 public:
  Unpacker(ScanWindow& window, ArchiveHead head, Proof proof, const ByteSink& sink)
      : window_(window),
        head_(std::move(head)),
        proof_(proof),
        sink_(sink),
        planes_(head_.record),
        crc32c_(head_.crc32c) {}

  Result<PackedScan> unpack() {
    if (context_ == nullptr) return error(Code::internal, "%s: zstd has no memory", window_.name());
    for (;;) {
      const std::uint64_t at = window_.offset();
      if (Status status = read_block(); !status) return status.error();
      if (block_.kind == Kind::end) return finish(at);
      if (Status status = restore(at); !status) return status.error();
      if (crc32c(original_) != block_.original_crc32c)
        return damaged(window_, at, "the block is not restored as it was");
      done_ += original_.size();
      if (proof_ == Proof::sha256) sha256_.add(original_);
      if (Status status = sink_(original_); !status) return status.error();
    }
  }

 private:
  /// Reads a block into block_ and packed_. Its lengths are valid then, and its bytes are those that were written.
  Status read_block() {
    const std::uint64_t at = window_.offset();
    std::array<std::byte, kBlockHeadBytes> head{};
    if (!window_.read(head.data(), head.size())) return window_.failure();
    block_.kind = get<Kind>(head, 0);
    block_.coding = {get<std::uint8_t>(head, 1), get<std::uint8_t>(head, 2)};
    block_.original_bytes = get<std::uint32_t>(head, 4);
    block_.packed_bytes = get<std::uint32_t>(head, 8);
    block_.original_crc32c = get<std::uint32_t>(head, 12);
    block_.crc32c = get<std::uint32_t>(head, kBlockFieldsBytes);
    if (const char* why = reason_against_block(); why != nullptr) return damaged(window_, at, why);
    packed_.resize(block_.packed_bytes);
    if (!window_.read(packed_.data(), packed_.size())) return window_.failure();
    crc32c_ = crc32c(std::span(head).first(kBlockFieldsBytes), crc32c_);
    crc32c_ = crc32c(packed_, crc32c_);
    if (crc32c_ == block_.crc32c) return success();
    return error(Code::frame_incomplete, "%s: byte %llu: damaged between here and byte %llu: the checksum is wrong",
                 window_.name(), printed(at), printed(window_.offset()));
  }

  /// Why a block cannot be one of this archive; nullptr if it can.
  [[nodiscard]] const char* reason_against_block() const {
    const std::size_t record_bytes = head_.record.bytes();
    std::uint64_t original_max = 0;
    std::uint64_t packed_max = kPackedBytesMax;
    switch (block_.kind) {
      case Kind::bytes: original_max = kPlainBytesMax; break;
      case Kind::points: original_max = kPackedPointsMax * record_bytes; break;
      case Kind::end: packed_max = kEndBytes; break;
      default: return "damaged: not the begin of a block";
    }
    if (block_.original_bytes > original_max || (block_.original_bytes == 0) != (block_.kind == Kind::end))
      return "damaged: a block of impossible size";
    if (block_.kind == Kind::points && block_.original_bytes % record_bytes != 0)
      return "damaged: a block that does not end with a point";
    if (block_.packed_bytes == 0 || block_.packed_bytes > packed_max)
      return "damaged: a block of impossible packed size";
    if (block_.kind == Kind::end && block_.packed_bytes != kEndBytes) return "damaged: an end without SHA-256";
    if (block_.original_bytes > head_.packed.bytes - done_) return "damaged: more data than the head states";
    if (block_.packed_bytes > window_.left()) return "the archive ends within this block";
    return nullptr;
  }

  /// Restores original_ from the block at `at`.
  Status restore(std::uint64_t at) {
    const bool is_points = block_.kind == Kind::points;
    original_.resize(block_.original_bytes);
    std::vector<std::byte>& to = is_points ? unpacked_ : original_;
    if (is_points) {
      const std::size_t points = original_.size() / head_.record.bytes();
      unpacked_.resize((points + 7) / 8 + original_.size());
    }
    const std::size_t bytes = ZSTD_decompressDCtx(context_.get(), to.data(), to.size(), packed_.data(), packed_.size());
    if (ZSTD_isError(bytes) != 0)
      return error(Code::frame_incomplete, "%s: byte %llu: zstd: %s", window_.name(), printed(at + kBlockHeadBytes),
                   ZSTD_getErrorName(bytes));
    if (is_points) {
      const std::uint64_t first = points_;
      points_ += original_.size() / head_.record.bytes();
      if (planes_.join(block_.coding, std::span(unpacked_).first(bytes), first, original_)) return success();
    } else if (bytes == to.size()) {
      return success();
    }
    return damaged(window_, at, "the block has another content than its head states");
  }

  Result<PackedScan> finish(std::uint64_t at) {
    if (done_ != head_.packed.bytes)
      return error(Code::frame_incomplete, "%s: byte %llu: the data end after %llu bytes, the head states %llu",
                   window_.name(), printed(at), printed(done_), printed(head_.packed.bytes));
    if (window_.left() != 0) return damaged(window_, window_.offset(), "bytes after the end of the archive");
    std::array<std::uint8_t, kEndBytes> digest{};
    std::memcpy(digest.data(), packed_.data(), digest.size());
    if (proof_ == Proof::sha256 && digest != sha256_.digest())
      return damaged(window_, at + kBlockHeadBytes, "the unpacked file has another SHA-256 than the original had");
    head_.packed.sha256 = hex(digest);
    return head_.packed;
  }

  ScanWindow& window_;
  ArchiveHead head_;
  Proof proof_;
  const ByteSink& sink_;
  PointPlanes planes_;
  std::unique_ptr<ZSTD_DCtx, FreeDecompressor> context_{ZSTD_createDCtx()};
  Sha256 sha256_;
  BlockHead block_;
  std::uint32_t crc32c_;      ///< of all blocks so far
  std::uint64_t done_ = 0;    ///< restored bytes
  std::uint64_t points_ = 0;  ///< restored points
  std::vector<std::byte> packed_;
  std::vector<std::byte> unpacked_;  ///< planes
  std::vector<std::byte> original_;
};

}  // namespace

Result<PackedScan> pack_scan(const char* path, const ByteSink& sink) {
  const Result<int> opened = open_scan(AT_FDCWD, path, path);
  if (!opened) return opened.error();
  const Fd fd(opened.value());
  const Result<std::uint64_t> bytes = size_of(fd.get(), path);
  if (!bytes) return bytes.error();
  const std::string name = std::filesystem::path(path).filename().string();
  if (!is_file_name(name)) return error(Code::config, "%s: a file of this name cannot be packed", path);
  if (bytes.value() > kPackedFileBytesMax)
    return error(Code::config, "%s: %llu bytes, packed are at most %llu", path, printed(bytes.value()),
                 printed(kPackedFileBytesMax));
  if (is_packed(fd.get())) return error(Code::config, "%s: it is packed already", path);
  ScanWindow window(fd.get(), path, bytes.value());
  return Packer(window, name, find_run(fd.get(), path, bytes.value()), sink).pack();
}

Result<PackedScan> unpack_scan_fd(int fd, const char* name, Proof proof, const ByteSink& sink) {
  const Result<std::uint64_t> bytes = size_of(fd, name);
  if (!bytes) return bytes.error();
  ScanWindow window(fd, name, bytes.value());
  Result<ArchiveHead> head = read_head(window);
  if (!head) return head.error();
  return Unpacker(window, std::move(head.value()), proof, sink).unpack();
}

Result<PackedScan> unpack_scan(const char* path, const ByteSink& sink) {
  const Result<int> opened = open_scan(AT_FDCWD, path, path);
  if (!opened) return opened.error();
  const Fd fd(opened.value());
  return unpack_scan_fd(fd.get(), path, Proof::sha256, sink);
}

Result<PackedScan> packed_scan_at(const char* path) {
  const Result<int> opened = open_scan(AT_FDCWD, path, path);
  if (!opened) return opened.error();
  const Fd fd(opened.value());
  const Result<std::uint64_t> bytes = size_of(fd.get(), path);
  if (!bytes) return bytes.error();
  ScanWindow window(fd.get(), path, bytes.value());
  Result<ArchiveHead> head = read_head(window);
  if (!head) return head.error();
  if (window.left() < kBlockHeadBytes + kEndBytes) return damaged(window, window.offset(), "the archive ends here");
  const std::uint64_t at = window.file_bytes() - kEndBytes - kBlockHeadBytes;
  std::array<std::byte, kBlockHeadBytes> end{};
  std::array<std::uint8_t, kEndBytes> digest{};
  if (!window.look_at(at, end.data(), end.size()) || !window.look_at(at + end.size(), digest.data(), digest.size()))
    return window.failure();
  // The checksum of the end covers the whole archive; its head alone shows whether something is missing behind it.
  if (get<Kind>(end, 0) != Kind::end || get<std::uint32_t>(end, 4) != 0 || get<std::uint32_t>(end, 8) != kEndBytes)
    return damaged(window, at, "not the end of an archive");
  head.value().packed.sha256 = hex(digest);
  return head.value().packed;
}

bool is_packed(int fd) {
  std::array<char, kMagic.size()> begin{};
  return pread(fd, begin.data(), begin.size(), 0) == static_cast<ssize_t>(begin.size()) && begin == kMagic;
}

Result<UnpackedScan> unpack_into_memory(int fd, const char* name, Proof proof) {
  UnpackedScan unpacked;
  unpacked.fd = Fd(memfd_create("scan", MFD_CLOEXEC));
  if (!unpacked.fd.is_open()) return error(Code::internal, "%s: no file in memory: %s", name, errno_text(errno));
  Result<PackedScan> packed = unpack_scan_fd(fd, name, proof, [&](std::span<const std::byte> bytes) {
    return write_all(unpacked.fd.get(), bytes.data(), bytes.size())
               ? success()
               : Status(error(Code::internal, "%s: no memory to unpack it: %s", name, errno_text(errno)));
  });
  if (!packed) return packed.error();
  unpacked.packed = std::move(packed.value());
  // The extension of the original selects its reader.
  unpacked.name = std::string(name) + ": " + unpacked.packed.name;
  return unpacked;
}

Result<CheckedScan> check_packed_scan(const char* path, LengthUnit unit) {
  const Result<int> opened = open_scan(AT_FDCWD, path, path);
  if (!opened) return opened.error();
  const Fd fd(opened.value());
  Result<UnpackedScan> unpacked = unpack_into_memory(fd.get(), path, Proof::sha256);
  if (!unpacked) return unpacked.error();
  CheckedScan checked;
  checked.packed = std::move(unpacked.value().packed);
  const Result<ScanChecksum> sum =
      read_scan_checksum_fd(unpacked.value().fd.get(), unpacked.value().name.c_str(), unit);
  if (sum) checked.points_crc32c = sum.value().crc32c;
  return checked;
}

}  // namespace slabd::hal
