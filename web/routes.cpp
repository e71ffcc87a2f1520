// SPDX-License-Identifier: Apache-2.0
#include "web/routes.h"

#include <algorithm>
#include <array>
#include <optional>

namespace slabd::web {
namespace {

using P = RouteParameter;

// Filters of slabs, as `slabctl history` has them.
constexpr std::array kSlabs = {
    P{"limit", Form::rows, "--limit"},           P{"since", Form::time, "--since"},   P{"until", Form::time, "--until"},
    P{"slab_type", Form::number, "--slab-type"}, P{"mould", Form::number, "--mould"}, P{"id", Form::text, "--id"},
    P{"verdict", Form::verdict, "--verdict"},    P{"block", Form::block, "--block"},  P{"item", Form::item, "--item"}};
constexpr std::array kLanguage = {P{"language", Form::language, "--language"}};
constexpr std::array kReport = {P{"language", Form::language, "--language"}, P{"full", Form::flag, "--full"}};
constexpr std::array kCapability = {P{"slab_type", Form::number, "--slab-type"}, P{"slabs", Form::number, "--slabs"},
                                    P{"since", Form::time, "--since"}, P{"until", Form::time, "--until"},
                                    P{"language", Form::language, "--language"}};
constexpr std::array kTrend = {P{"block", Form::block, "--block"},  P{"slab_type", Form::number, "--slab-type"},
                               P{"slabs", Form::number, "--slabs"}, P{"since", Form::time, "--since"},
                               P{"until", Form::time, "--until"},   P{"language", Form::language, "--language"}};
constexpr std::array kYield = {P{"by", Form::group, "--by"}, P{"since", Form::time, "--since"},
                               P{"until", Form::time, "--until"}, P{"slab_type", Form::number, "--slab-type"},
                               P{"language", Form::language, "--language"}};
constexpr std::array kReasons = {P{"since", Form::time, "--since"}, P{"until", Form::time, "--until"},
                                 P{"slab_type", Form::number, "--slab-type"}, P{"verdict", Form::verdict, "--verdict"}};
constexpr std::array kCompare = {P{"a", Form::key, ""}, P{"b", Form::key, ""}, P{"all", Form::flag, "--all"},
                                 P{"language", Form::language, "--language"}};
constexpr std::array kMoulds = {P{"slab_type", Form::number, "--slab-type"}, P{"slabs", Form::number, "--castings"},
                                P{"since", Form::time, "--since"}, P{"until", Form::time, "--until"}};
// Language of the documents that slabd-web composes.
constexpr std::array kOwnLanguage = {P{"language", Form::language, ""}};
constexpr std::array kPlant = {P{"days", Form::number, "--days"}};
constexpr std::array kFound = {P{"id", Form::text, ""}};

/// A statistic of many slabs that is older than this is not given.
constexpr double kRenew_s = 600.0;

constexpr std::array kRoutes = {
    Route{"/api/v1/status", Maker::status, "slabd.web_status/1", 0.2, "", kOwnLanguage},
    Route{"/api/v1/slabs", Maker::slabctl, "slabd.history/1", 2, "history --json", kSlabs},
    Route{"/api/v1/slabs/{key}", Maker::slabctl, "slabd.slab/1", 5, "show --json -- {key}", {}},
    Route{"/api/v1/slabs/{key}/map", Maker::slabctl, "slabd.slab_map/1", 2, "show --map --json -- {key}", kLanguage},
    Route{"/api/v1/slabs/{key}/blocks/{block}",
          Maker::slabctl,
          "slabd.slab/1",
          5,
          "show --block={block} --json -- {key}",
          {}},
    Route{"/api/v1/slabs/{key}/blocks/{block}/map", Maker::slabctl, "slabd.block_map/1", 5,
          "show --block={block} --map --json -- {key}", kLanguage},
    Route{"/api/v1/slabs/{key}/blocks/{block}/cloud",
          Maker::slabctl,
          "slabd.block_cloud/1",
          5,
          "show --block={block} --cloud --json -- {key}",
          {}},
    Route{"/api/v1/slabs/{key}/report.pdf", Maker::report, "", 5, "report --out={file} -- {key}", kReport},
    Route{"/api/v1/slabs/{key}/pin", Maker::slabctl, "slabd.pin_state/1", 1, "pin --show --json -- {key}", {}},
    Route{"/api/v1/trends", Maker::slabctl, "slabd.capability/1", 60, "trend --json", kCapability, kRenew_s},
    Route{"/api/v1/trends/{item}", Maker::slabctl, "slabd.trend/1", 60, "trend --json -- {item}", kTrend, kRenew_s},
    Route{"/api/v1/yield", Maker::slabctl, "slabd.yield/1", 30, "yield --json", kYield, kRenew_s},
    Route{"/api/v1/reasons", Maker::slabctl, "slabd.reasons/1", 60, "reasons --json", kReasons, kRenew_s},
    Route{"/api/v1/compare", Maker::slabctl, "slabd.comparison/1", 5, "compare --json -- {a} {b}", kCompare},
    Route{"/api/v1/moulds", Maker::slabctl, "slabd.moulds/1", 60, "mould list --json", kMoulds, kRenew_s},
    Route{"/api/v1/moulds/{mould}/sheet.pdf", Maker::report, "", 60, "mould sheet --out={file} -- {mould}", kLanguage},
    Route{"/api/v1/calibration", Maker::calibration, "slabd.web_calibration/1", 10, "", kOwnLanguage},
    Route{"/api/v1/doctor", Maker::slabctl, "slabd.doctor/1", 10, "doctor --no-write --json", kLanguage},
    Route{"/api/v1/plant", Maker::plant, "slabd.plant_overview/1", 60, "--show=overview", kPlant},
    Route{"/api/v1/plant/slab", Maker::plant, "slabd.plant_found/1", 10, "--show=slab={id}", kFound},
    Route{"/api/v1/drafts", Maker::slabctl, "slabd.recipe_drafts/1", 5, "recipe drafts --json", {}},
    Route{"/api/v1/drafts/{draft}", Maker::slabctl, "slabd.cad_draft/1", 5, "recipe drafts --json -- {draft}", {}},
    Route{"/api/v1/drafts/{draft}/picture.png", Maker::report, "", 5, "recipe drafts --picture={file} -- {draft}", {}},
    Route{"/api/v1/session", Maker::session, "slabd.web_session/1", 0, "", {}},
    Route{"/api/v1/words", Maker::words, "slabd.web_words/1", 3'600, "", kOwnLanguage},
};

/// kMost of web/page/src/pages/slabs.js.
constexpr std::string_view kRowsMax = "2000";
/// Longest values; the pattern of a form decides about the rest.
constexpr std::size_t kItemBytesMax = 40;
constexpr std::size_t kTextBytesMax = 96;
constexpr std::size_t kDraftBytesMax = 64;

bool consists_of(std::string_view value, std::string_view letters, std::size_t least, std::size_t most) {
  return value.size() >= least && value.size() <= most && value.find_first_not_of(letters) == std::string_view::npos;
}

bool is_one_of(std::string_view value, std::initializer_list<std::string_view> words) {
  return std::find(words.begin(), words.end(), value) != words.end();
}

bool has_form(std::string_view value, Form form) {
  constexpr std::string_view kDigits = "0123456789";
  switch (form) {
    case Form::key: return consists_of(value, kDigits, 1, 18);
    case Form::number: return consists_of(value, kDigits, 1, 6);
    case Form::rows:
      return consists_of(value, kDigits, 1, kRowsMax.size()) && value[0] != '0' &&
             (value.size() < kRowsMax.size() || value <= kRowsMax);
    case Form::block: {
      const bool two = value.size() == 2 && value[0] == '1' && value[1] >= '0' && value[1] <= '8';
      return two || (value.size() == 1 && value[0] >= '1' && value[0] <= '9');
    }
    case Form::item: return consists_of(value, "abcdefghijklmnopqrstuvwxyz_", 1, kItemBytesMax);
    case Form::time:
      return consists_of(value, "0123456789-:TZdhmw", 2, 25) && kDigits.find(value[0]) != std::string_view::npos;
    case Form::text: return !value.empty() && value.size() <= kTextBytesMax;
    case Form::flag: return is_one_of(value, {"0", "1"});
    case Form::draft: {
      constexpr std::string_view kLetters = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789._-";
      return consists_of(value, kLetters, 1, kDraftBytesMax) && value[0] != '.' && value[0] != '-';
    }
    case Form::verdict: return is_one_of(value, {"pass", "fail", "indeterminate", "not_measured", "aborted"});
    case Form::group: return is_one_of(value, {"day", "shift", "type", "mould"});
    case Form::language: return is_one_of(value, {"en", "zh"});
  }
  return false;
}

std::string_view words_of(Form form) {
  switch (form) {
    case Form::key: return "the key of a slab, digits";
    case Form::number: return "a number of up to 6 digits";
    case Form::rows: return "1..2000";
    case Form::block: return "1..18";
    case Form::item: return "the name of an item, such as seat_slope";
    case Form::time: return "2026-11-20, 2026-11-20T08:00:00Z, 7d or 12h";
    case Form::text: return "1 to 96 bytes of text";
    case Form::flag: return "0 or 1";
    case Form::draft: return "the name of a draft: letters, digits, '.', '_', '-'";
    case Form::verdict: return "pass, fail, indeterminate, not_measured or aborted";
    case Form::group: return "day, shift, type or mould";
    case Form::language: return "en or zh";
  }
  return "";
}

std::string_view next_part(std::string_view& path) {
  path.remove_prefix(1);
  const std::string_view part = path.substr(0, path.find('/'));
  path.remove_prefix(part.size());
  return part;
}

using Values = std::vector<std::pair<std::string_view, std::string_view>>;

/// Values of the parts in braces; nullopt if the path is another one.
std::optional<Values> match(std::string_view pattern, std::string_view path) {
  Values values;
  while (!pattern.empty() && !path.empty()) {
    const std::string_view wanted = next_part(pattern);
    const std::string_view part = next_part(path);
    if (!wanted.starts_with('{')) {
      if (wanted != part) return std::nullopt;
      continue;
    }
    const std::string_view name = wanted.substr(1, wanted.size() - 2);
    const Form form = name == "key"     ? Form::key
                      : name == "block" ? Form::block
                      : name == "mould" ? Form::number
                      : name == "draft" ? Form::draft
                                        : Form::item;
    if (!has_form(part, form)) return std::nullopt;
    values.emplace_back(name, part);
  }
  if (!pattern.empty() || !path.empty()) return std::nullopt;
  return values;
}

/// The word of the command with its placeholder replaced. A key is marked, because a number may also be a SLAB_ID.
std::string filled(std::string_view word, const Values& values) {
  std::string out(word);
  for (const auto& [name, value] : values) {
    const std::string mark = "{" + std::string(name) + "}";
    const bool is_key = name == "key" || name == "a" || name == "b";
    if (const std::size_t at = out.find(mark); at != std::string::npos)
      out.replace(at, mark.size(), (is_key ? "key:" : "") + std::string(value));
  }
  return out;
}

std::vector<std::string> arguments_of(const Route& route, const Values& values,
                                      const std::vector<std::string>& options) {
  std::vector<std::string> arguments;
  bool inserted = false;
  std::string_view rest = route.arguments;
  while (!rest.empty()) {
    const std::string_view word = rest.substr(0, rest.find(' '));
    rest.remove_prefix(std::min(rest.size(), word.size() + 1));
    if (word == "--") {
      arguments.insert(arguments.end(), options.begin(), options.end());
      inserted = true;
    }
    arguments.push_back(filled(word, values));
  }
  if (!inserted) arguments.insert(arguments.end(), options.begin(), options.end());
  return arguments;
}

std::string names_of(const Route& route) {
  std::string names;
  for (const RouteParameter& parameter : route.parameters)
    names += (names.empty() ? "" : ", ") + std::string(parameter.name);
  return names;
}

std::variant<Request, Refusal> request_of(const Route& route, Values values, const Target& target) {
  std::vector<std::string> options;
  Request request{&route, {}, {}};
  for (const TargetParameter& given : target.parameters) {
    const auto known = std::find_if(route.parameters.begin(), route.parameters.end(),
                                    [&](const RouteParameter& parameter) { return parameter.name == given.name; });
    if (known == route.parameters.end())
      return Refusal{
          400, "parameter '" + given.name + "' is not known here",
          route.parameters.empty() ? "this document has no parameters" : "parameters are " + names_of(route)};
    if (!has_form(given.value, known->form))
      return Refusal{400, "parameter '" + given.name + "' has another form",
                     "allowed is " + std::string(words_of(known->form))};
    if (known->form == Form::language) request.language = given.value;
    if (known->option.empty())
      values.emplace_back(known->name, given.value);
    else if (known->form != Form::flag)
      options.push_back(std::string(known->option) + "=" + given.value);
    else if (given.value == "1")
      options.emplace_back(known->option);
  }
  for (const RouteParameter& parameter : route.parameters) {
    const auto given = [&](const auto& value) { return value.first == parameter.name; };
    const bool is_required = route.arguments.find("{" + std::string(parameter.name) + "}") != std::string_view::npos;
    if (is_required && std::none_of(values.begin(), values.end(), given))
      return Refusal{400, "parameter '" + std::string(parameter.name) + "' is missing",
                     "it is " + std::string(words_of(parameter.form))};
  }
  request.arguments = arguments_of(route, values, options);
  return request;
}

}  // namespace

std::span<const Route> routes() {
  return kRoutes;
}

std::variant<Request, Refusal> find_document(const Target& target) {
  for (const Route& route : kRoutes)
    if (std::optional<Values> values = match(route.path, target.path))
      return request_of(route, std::move(*values), target);
  return Refusal{404, "no document is at this path", "docs/WEB.md lists the paths"};
}

std::optional<WriteRequest> find_write(const Target& target) {
  constexpr std::array<std::pair<std::string_view, Write>, 5> kWrites = {
      {{"/api/v1/login", Write::login},
       {"/api/v1/logout", Write::logout},
       {"/api/v1/slabs/{key}/disposition", Write::disposition},
       {"/api/v1/slabs/{key}/pin", Write::pin},
       {"/api/v1/slabs/{key}/unpin", Write::unpin}}};
  for (const auto& [path, write] : kWrites)
    if (const std::optional<Values> values = match(path, target.path))
      return WriteRequest{write, values->empty() ? "" : "key:" + std::string(values->front().second)};
  return std::nullopt;
}

bool is_page(std::string_view path) {
  constexpr std::array<std::string_view, 15> kPages = {
      "/",        "/slabs",  "/slabs/{key}",   "/slabs/{key}/blocks/{block}",
      "/trends",  "/moulds", "/calibration",   "/line",
      "/compare", "/about",  "/login",         "/trends/{item}",
      "/plant",   "/drafts", "/drafts/{draft}"};
  return std::any_of(kPages.begin(), kPages.end(),
                     [&](std::string_view page) { return page == path || match(page, path).has_value(); });
}

}  // namespace slabd::web
