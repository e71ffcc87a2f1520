// SPDX-License-Identifier: Apache-2.0
#include <array>

#include "hal/scan/scan_file.h"
#include "hal/scan/text_lines.h"

// One table of the formats that are written and one of the extensions that are read.
namespace slabd::hal {
namespace {

struct WrittenFormat {
  ScanFormat format;
  std::string_view name;
  std::string_view extension;
};
constexpr std::array<WrittenFormat, kScanFormats.size()> kWritten = {{
    {ScanFormat::ply, "ply", "ply"},
    {ScanFormat::ply_ascii, "ply-ascii", "ply"},
    {ScanFormat::ply_be, "ply-be", "ply"},
    {ScanFormat::pcd, "pcd", "pcd"},
    {ScanFormat::pcd_ascii, "pcd-ascii", "pcd"},
    {ScanFormat::pcd_compressed, "pcd-compressed", "pcd"},
    {ScanFormat::xyz, "xyz", "xyz"},
    {ScanFormat::csv, "csv", "csv"},
}};

struct ReadExtension {
  std::string_view extension;
  ScanFamily family;
};
constexpr std::array<ReadExtension, 6> kRead = {{{"ply", ScanFamily::ply},
                                                 {"pcd", ScanFamily::pcd},
                                                 {"xyz", ScanFamily::text},
                                                 {"asc", ScanFamily::text},
                                                 {"txt", ScanFamily::text},
                                                 {"csv", ScanFamily::text}}};

const WrittenFormat& row_of(ScanFormat format) {
  return kWritten[static_cast<std::size_t>(format)];
}

}  // namespace

std::string_view name(ScanFormat format) {
  return row_of(format).name;
}

std::string_view extension(ScanFormat format) {
  return row_of(format).extension;
}

std::optional<ScanFormat> scan_format_named(std::string_view wanted) {
  for (const WrittenFormat& row : kWritten)
    if (row.name == wanted) return row.format;
  return std::nullopt;
}

std::optional<ScanFormat> scan_format_of(std::string_view path) {
  const std::string_view file_extension = extension_of(path);
  const std::optional<ScanFamily> family = scan_family(file_extension);
  if (!family) return std::nullopt;
  if (*family == ScanFamily::ply) return ScanFormat::ply;
  if (*family == ScanFamily::pcd) return ScanFormat::pcd;
  return lower_case(file_extension).view() == "csv" ? ScanFormat::csv : ScanFormat::xyz;
}

std::string_view extension_of(std::string_view path) {
  const std::size_t slash = path.rfind('/');
  const std::string_view file = slash == std::string_view::npos ? path : path.substr(slash + 1);
  const std::size_t dot = file.rfind('.');
  return dot == std::string_view::npos ? std::string_view{} : file.substr(dot + 1);
}

std::optional<ScanFamily> scan_family(std::string_view file_extension) {
  const FixedString<16> lower = lower_case(file_extension);
  for (const ReadExtension& row : kRead)
    if (lower == row.extension) return row.family;
  return std::nullopt;
}

}  // namespace slabd::hal
