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

}  // namespace slabd::hal
