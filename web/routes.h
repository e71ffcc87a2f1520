// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "web/target.h"

/// The documents of slabd-web: one table of paths, and for each the arguments of slabctl that print the document. A
/// value from a browser reaches slabctl only if it has the form that its parameter allows.
namespace slabd::web {

/// Forms of values. Each is a closed pattern; slabctl checks the meaning.
enum class Form : std::uint8_t {
  key,       ///< key of a slab: 1 to 18 digits
  number,    ///< 1 to 6 digits
  rows,      ///< 1 to 2000, the longest list of the page: a longer one takes more memory than the unit has (MemoryMax)
  block,     ///< 1 to 18
  item,      ///< lower-case letters and "_", 1 to 40
  time,      ///< 2026-11-20, 2026-11-20T08:00:00Z, 7d, 12h: digits, "-", ":", "T", "Z", "d", "h", "m", "w", 2 to 25
  text,      ///< part of a SLAB_ID: 1 to 96 bytes
  flag,      ///< 0 or 1
  draft,     ///< letters, digits, ".", "_", "-", 1 to 64; the first is not "." or "-"
  verdict,   ///< pass, fail, indeterminate, not_measured, aborted
  group,     ///< day, shift, type
  language,  ///< en, zh
};

struct RouteParameter {
  std::string_view name;
  Form form;
  /// Option of slabctl: "--limit" is passed as --limit=VALUE, of a flag as --limit if it is 1. Empty: the value
  /// replaces "{name}" in the arguments, and is required if they contain it.
  std::string_view option;
};

/// Program part that makes a document.
enum class Maker : std::uint8_t {
  slabctl,      ///< one process of slabctl
  plant,        ///< a process of slabd-plant
  report,       ///< one process of slabctl that writes a file, PDF or PNG; with a longer time limit
  calibration,  ///< the control socket and two processes of slabctl
  status,       ///< the state of the line, as the poller stored it
  session,      ///< who is logged in
  words,        ///< names of items, verdicts and reasons from room report
};

struct Route {
  /// "{name}" is a part with a value: {key} as Form::key, {block} as Form::block, {item} as Form::item,
  /// {mould} as Form::number, {draft} as Form::draft.
  std::string_view path;
  Maker maker;
  std::string_view schema;  ///< of the document; empty for a file
  double cache_s;           ///< time for which an answer is used again
  /// Words of the command, separated by blanks. "{key}" becomes "key:12", "{file}" the path of a report. Options from
  /// parameters are inserted before " -- ".
  std::string_view arguments;
  std::span<const RouteParameter> parameters;
  double renew_s = 0.0;  ///< DocumentOrder::renew_s
};

[[nodiscard]] std::span<const Route> routes();

/// A document that was asked for.
struct Request {
  const Route* route = nullptr;
  std::vector<std::string> arguments;  ///< of slabctl; empty unless the maker is slabctl or report
  std::string language;                ///< value of the parameter `language`; empty if it was not given
};

/// Answer instead of a document.
struct Refusal {
  int status = 404;
  std::string text;
  std::string cure;
};

/// The document at a path below /api/v1/. Refusal 404: no such path; 400: a parameter is unknown, missing, or has
/// another form.
[[nodiscard]] std::variant<Request, Refusal> find_document(const Target& target);

/// Effect of a request with POST.
enum class Write : std::uint8_t { login, logout, disposition, pin, unpin };
struct WriteRequest {
  Write write = Write::login;
  std::string key;  ///< "key:12" of a slab; empty for login and logout
};
/// nullopt if nothing is written at this path.
[[nodiscard]] std::optional<WriteRequest> find_write(const Target& target);

/// True if the path belongs to a page, which is the same HTML document for all of them.
[[nodiscard]] bool is_page(std::string_view path);

}  // namespace slabd::web
