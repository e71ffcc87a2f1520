// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <string_view>

#include "base/base.h"
#include "base/jobs.h"
#include "base/utf8.h"

namespace slabd::hal {

/// Text inside the quotes of a JSON string, as much as leaves room for `tail_bytes` behind it. All but plain ASCII is
/// escaped: what a gateway takes its lines to be written in does not matter then. A byte that is no UTF-8 counts as the
/// character of that number.
template <std::size_t Capacity>
void append_json_text(FixedString<Capacity>& json, std::string_view text, std::size_t tail_bytes) {
  while (!text.empty()) {
    const CodePoint c = code_point_at(text);
    FixedString<12> escaped;
    if (c.value > 0xFFFF)
      escaped.printf("\\u%04x\\u%04x", static_cast<unsigned>(0xD7C0 + (c.value >> 10U)),
                     static_cast<unsigned>(0xDC00 + (c.value & 0x3FFU)));
    else if (c.value < 0x20 || c.value > 0x7E || c.value == '"' || c.value == '\\')
      escaped.printf("\\u%04x", static_cast<unsigned>(c.value));
    else
      escaped.append(text.substr(0, 1));
    if (json.size() + escaped.size() + tail_bytes > Capacity) return;
    json.append(escaped.view());
    text.remove_prefix(c.bytes);
  }
}

/// slabd.scan_request/1 as one line; `more` are further members, each with a comma before it.
[[nodiscard]] inline FixedString<640> scan_request_json(const ScanRequest& request, std::string_view more = {}) {
  FixedString<640> json;
  json.printf(R"({"schema": "slabd.scan_request/1", "session": %u, "cmd_seq": %u, "slab_id": ")",
              unsigned{request.session}, unsigned{request.cmd_seq});
  FixedString<160> rest;
  rest.printf("\", \"station\": %u", unsigned{request.station});
  rest.append(more);
  rest.append("}\n");
  append_json_text(json, request.slab_id.view(), rest.size());
  json.append(rest.view());
  return json;
}

/// slabd.scan_answer/1 as one line: what became of the scan of that request; `why` null: it was taken.
[[nodiscard]] inline FixedString<640> scan_answer_json(std::uint16_t session, std::uint16_t cmd_seq, const Error* why,
                                                       std::size_t points) {
  FixedString<640> line;
  line.printf(R"({"schema": "slabd.scan_answer/1", "session": %u, "cmd_seq": %u, "ok": %s, "points": %zu)",
              unsigned{session}, unsigned{cmd_seq}, why == nullptr ? "true" : "false", points);
  constexpr std::string_view kEnd = "}\n";
  if (why != nullptr) {
    FixedString<48> code;
    code.printf(R"(, "code": %d, "error": ")", static_cast<int>(why->code));
    line.append(code.view());
    append_json_text(line, why->text.view(), 1 + kEnd.size());
    line.append("\"");
  }
  line.append(kEnd);
  return line;
}

}  // namespace slabd::hal
