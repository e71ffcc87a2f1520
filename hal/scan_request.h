// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string_view>

#include "base/base.h"
#include "base/jobs.h"

namespace slabd::hal {

/// Text inside the quotes of a JSON string: what is not plain ASCII is escaped byte by byte.
template <std::size_t Capacity>
void append_json_text(FixedString<Capacity>& json, std::string_view text) {
  for (const char c : text) {
    const auto byte = static_cast<unsigned char>(c);
    FixedString<8> escaped;
    if (byte < 0x20 || byte > 0x7E || c == '"' || c == '\\')
      escaped.printf("\\u%04x", unsigned{byte});
    else
      escaped.append({&c, 1});
    json.append(escaped.view());
  }
}

/// slabd.scan_request/1 as one line; `more` are further members, each with a comma before it.
[[nodiscard]] inline FixedString<640> scan_request_json(const ScanRequest& request, std::string_view more = {}) {
  FixedString<640> json;
  json.printf(R"({"schema": "slabd.scan_request/1", "session": %u, "cmd_seq": %u, "slab_id": ")",
              unsigned{request.session}, unsigned{request.cmd_seq});
  append_json_text(json, request.slab_id.view());
  FixedString<32> rest;
  rest.printf("\", \"station\": %u", unsigned{request.station});
  json.append(rest.view());
  json.append(more);
  json.append("}\n");
  return json;
}

/// slabd.scan_answer/1 as one line: what became of the scan of that request; `why` null: it was taken.
[[nodiscard]] inline FixedString<640> scan_answer_json(std::uint16_t session, std::uint16_t cmd_seq, const Error* why,
                                                       std::size_t points) {
  FixedString<640> line;
  line.printf(R"({"schema": "slabd.scan_answer/1", "session": %u, "cmd_seq": %u, "ok": %s, "points": %zu)",
              unsigned{session}, unsigned{cmd_seq}, why == nullptr ? "true" : "false", points);
  if (why != nullptr) {
    FixedString<48> code;
    code.printf(R"(, "code": %d, "error": ")", static_cast<int>(why->code));
    line.append(code.view());
    append_json_text(line, why->text.view());
    line.append("\"");
  }
  line.append("}\n");
  return line;
}

}  // namespace slabd::hal
