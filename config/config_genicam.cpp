// SPDX-License-Identifier: Apache-2.0
//
// [genicam] -> GenicamSettings, for slabd-genicam. As with [web], a fault in this table does not stop the inspection.
#include <fmt/format.h>

#include "config/config_parts.h"

namespace slabd::config {
namespace {

/// A host name (RFC 1035, 2.3.4) is the longest way to name a camera.
constexpr std::size_t kCameraBytesMax = 253;
/// Largest packet of an Ethernet with jumbo frames; more does not pass any switch.
constexpr std::int64_t kPacketBytesMax = 16'260;
/// Smallest packet that every IPv4 network passes in one piece (RFC 791).
constexpr std::int64_t kPacketBytesMin = 576;

}  // namespace

void read_genicam(TableReader genicam, GenicamSettings& out, std::string& scanner) {
  genicam.optional_text("camera", out.camera, kCameraBytesMax);
  read_endpoint(genicam, "slabd", 1, out.slabd_host, out.slabd_port);
  genicam.optional_text("component", out.component, GenicamSettings::kNameBytesMax);
  std::size_t unit = out.unit_required ? 0 : 1;
  genicam.optional_word("unit_check", unit, {"required", "if_stated"});
  out.unit_required = unit == 0;
  std::int64_t packet_bytes = out.packet_bytes;
  genicam.optional_integer("packet_size", packet_bytes, kPacketBytesMin, kPacketBytesMax);
  if (packet_bytes % 4 != 0)
    genicam.problem("packet_size", fmt::format("found {}, allowed are multiples of 4", packet_bytes));
  out.packet_bytes = static_cast<int>(packet_bytes);
  genicam.optional_number("timeout_s", out.timeout_s, {0.5, 60.0});
  std::size_t trigger = static_cast<std::size_t>(out.trigger);
  genicam.optional_word("trigger", trigger, {"software", "acquisition_start"});
  out.trigger = static_cast<GenicamSettings::Trigger>(trigger);
  genicam.optional_text("scanner", scanner, PartId::capacity());
  genicam.optional_text("accepted", out.accepted, GenicamSettings::kAcceptedBytesMax);
  genicam.optional_boolean("emulated", out.emulated);
  genicam.finish();
}

void load_genicam(const std::string& path, GenicamSettings& settings, std::vector<Problem>& problems) {
  const std::optional<std::string> bytes = read_text_file(path, problems);
  if (!bytes) return;
  TomlValue tree;
  if (!parse_toml(path, *bytes, tree, problems)) return;
  TableReader root(path, &tree, "", problems);
  // The same computer: slabd's own address is the default.
  std::vector<Problem> of_others;
  TableReader all(path, &tree, "", of_others);
  TableReader genicam = root.table("genicam");
  std::string id;
  GenicamSettings of_camera;
  read_genicam(genicam, of_camera, id);
  const TomlValue* const of_scanners = all.value("scanner");
  const bool is_list = of_scanners != nullptr && of_scanners->kind == TomlValue::Kind::array;
  std::vector<const TomlValue*> streams;
  if (is_list)
    for (const TomlValue& one : of_scanners->items) {
      TableReader table(path, &one, "scanner", of_others);
      std::string own_id = "1";
      std::string backend;
      table.optional_text("id", own_id, PartId::capacity());
      table.optional_text("backend", backend, PartId::capacity());
      if (backend == "tcp" && (id.empty() || id == own_id)) streams.push_back(&one);
    }
  if (is_list && streams.size() != 1)
    genicam.problem("scanner", fmt::format("{} of the [[scanner]] with backend \"tcp\" {}; name one by its id",
                                           streams.size(), streams.size() == 1 ? "fits" : "fit"));
  TableReader scanner = is_list ? TableReader(path, streams.empty() ? nullptr : streams[0], "scanner", of_others)
                                : all.table("scanner");
  read_endpoint(scanner, "listen", 1, settings.slabd_host, settings.slabd_port);
  if (settings.slabd_host.view() == "0.0.0.0") settings.slabd_host.assign("127.0.0.1");
  // Once more, with slabd's own address as the default of its key.
  std::vector<Problem> known;
  read_genicam(TableReader(path, &tree, "", known).table("genicam"), settings, id);
  if (settings.camera.empty() && problems.empty())
    genicam.missing("camera", "the camera's address, such as \"192.168.0.30\", or its id in arv-tool");
}

}  // namespace slabd::config
