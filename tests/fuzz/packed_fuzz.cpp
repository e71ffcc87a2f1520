// SPDX-License-Identifier: Apache-2.0
//
// Packed scans. Byte 0 of the input selects: 0 an archive, 1 an archive that gets correct checksums, 2 a PLY, 3 a PCD,
// 4 another file, which is packed and must come back. The rest is the file.
#include "hal/scan/packed.h"

#include <sys/mman.h>
#include <unistd.h>

#include <string>

#include "tests/fuzz/fuzz.h"
#include "tests/hal/scan/packed_repair.h"

using namespace slabd;       // NOLINT(google-build-using-namespace)
using namespace slabd::hal;  // NOLINT(google-build-using-namespace)

namespace {

ByteSink into(std::string& bytes) {
  return [&bytes](std::span<const std::byte> piece) {
    bytes.append(static_cast<const char*>(static_cast<const void*>(piece.data())), piece.size());
    return success();
  };
}

/// An open file with this content.
int memory_file(std::string_view content) {
  static const int fd = memfd_create("archive", MFD_CLOEXEC);
  fuzz::must(ftruncate(fd, 0) == 0, "a file in memory");
  fuzz::must(pwrite(fd, content.data(), content.size(), 0) == static_cast<ssize_t>(content.size()), "its content");
  return fd;
}

void unpack_anything(std::string_view archive) {
  std::uint64_t bytes = 0;
  const Result<PackedScan> unpacked =
      unpack_scan_fd(memory_file(archive), "a.slabz", Proof::sha256, [&bytes](std::span<const std::byte> piece) {
        fuzz::must(!piece.empty() && piece.size() <= std::size_t{4} << 20U, "a block is not larger than its limit");
        bytes += piece.size();
        return success();
      });
  fuzz::must(bytes <= kPackedFileBytesMax, "no more than the largest file comes out");
  if (!unpacked) {
    fuzz::must(!unpacked.error().text.empty(), "an error says why");
    return;
  }
  fuzz::must(unpacked.value().bytes == bytes, "the original has the stated size");
  fuzz::must(unpacked.value().name.find('/') == std::string::npos, "a name leads to no other folder");
}

void pack_and_unpack(const fuzz::InputFile& file, std::string_view content) {
  file.write(content);
  std::string archive;
  const Result<PackedScan> packed = pack_scan(file.path().c_str(), into(archive));
  // An archive as input is refused.
  if (!packed) return;
  fuzz::must(packed.value().packed_bytes == archive.size(), "the archive has the stated size");
  std::string restored;
  const Result<PackedScan> unpacked = unpack_scan_fd(memory_file(archive), "a.slabz", Proof::sha256, into(restored));
  fuzz::must(unpacked.ok(), "an archive can be unpacked");
  fuzz::must(restored == content, "the file comes back");
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const fuzz::InputFile ply(".ply");
  static const fuzz::InputFile pcd(".pcd");
  static const fuzz::InputFile other(".xyz");
  if (size == 0) return 0;
  const std::string_view rest = fuzz::text_of(data + 1, size - 1);
  switch (data[0] % 5) {
    case 0: unpack_anything(rest); break;
    case 1: unpack_anything(hal::test::with_checksums(std::string(rest))); break;
    case 2: pack_and_unpack(ply, rest); break;
    case 3: pack_and_unpack(pcd, rest); break;
    default: pack_and_unpack(other, rest); break;
  }
  return 0;
}
