// SPDX-License-Identifier: Apache-2.0
#include "web/site.h"

#include <algorithm>

#include "web/assets.h"
#include "web/routes.h"
#include "web/words.h"

namespace slabd::web {
namespace {

constexpr std::string_view kApi = "/api/";
constexpr std::string_view kAssets = "/assets/";

/// The document of an answer as a part of another document.
std::string part_of(const Answer& answer) {
  std::string text = answer.status == 200 ? body_of(answer) : "null";
  while (text.ends_with('\n')) text.pop_back();
  return text;
}

}  // namespace

Site::Site(std::vector<std::string> names, Documents& documents, Live& live)
    : names_(std::move(names)),
      documents_(documents),
      live_(live),
      words_en_(text_answer(words_document("en"), "application/json")),
      words_zh_(text_answer(words_document("zh"), "application/json")) {
  for (const Asset& asset : assets())
    files_.emplace_back(asset.name, text_answer(std::string(asset.bytes), std::string(media_type(asset.name))));
}

bool Site::is_known_host(const HttpRequest& request) const {
  return is_host(request.host, names_) ||
         is_host(request.host, {"localhost", "127.0.0.1", std::string(request.local_address)});
}

SharedAnswer Site::calibration(double cache_s) {
  const std::string state = live_.ask("calibration");
  const SharedAnswer history = documents_.get({{"calibrate", "history", "--json"}, cache_s});
  const SharedAnswer trend = documents_.get({{"calibrate", "check", "--json"}, cache_s});
  const bool is_state = state.find("\"slabd.calibration_state/1\"") != std::string::npos;
  return text_answer("{\"schema\":\"slabd.web_calibration/1\",\"state\":" + (is_state ? state : "null") +
                         ",\"history\":" + part_of(*history) + ",\"trend\":" + part_of(*trend) + "}\n",
                     "application/json");
}

SharedAnswer Site::document(const Target& target) {
  auto found = find_document(target);
  if (const Refusal* const refusal = std::get_if<Refusal>(&found))
    return error_answer(refusal->status, refusal->text, refusal->cure);
  const Request& request = *std::get_if<Request>(&found);
  switch (request.route->maker) {
    case Maker::status: return live_.answer();
    case Maker::words: return request.language == "zh" ? words_zh_ : words_en_;
    case Maker::calibration: return calibration(request.route->cache_s);
    case Maker::slabctl:
    case Maker::report: break;
  }
  return documents_.get({request.arguments, request.route->cache_s, request.route->maker == Maker::report});
}

SharedAnswer Site::find(std::string_view raw) {
  const std::optional<Target> target = parse_target(raw);
  if (!target) return error_answer(400, "the address is not one of this program", "docs/WEB.md lists the paths");
  const std::string& path = target->path;
  if (path.starts_with(kApi)) return document(*target);
  if (path == "/healthz") return text_answer("ok\n", "text/plain; charset=utf-8");
  const std::string_view name = path.starts_with(kAssets) ? std::string_view(path).substr(kAssets.size())
                                : is_page(path)           ? "index.html"
                                                          : "";
  const auto file = std::find_if(files_.begin(), files_.end(), [&](const auto& one) { return one.first == name; });
  if (file == files_.end()) return error_answer(404, "no page is at this path", "the pages begin at /");
  return file->second;
}

HttpReply Site::reply(const HttpRequest& request) {
  if (request.method != "GET" && request.method != "HEAD")
    return {405, error_answer(405, "only GET and HEAD are answered", "slabctl changes what can be changed")};
  if (request.has_body) return {400, error_answer(400, "a request has no body here", "send none")};
  if (!is_known_host(request))
    return {421, error_answer(421, "this name does not belong to this computer", "add it to [web] names")};
  HttpReply reply;
  reply.answer = find(request.target);
  reply.status = reply.answer->status;
  reply.may_keep = reply.status == 200;
  if (reply.may_keep && has_etag(request.if_none_match, reply.answer->etag)) reply.status = 304;
  return reply;
}

bool Site::is_slow(std::string_view target) {
  return target.starts_with(kApi) && !target.starts_with("/api/v1/status");
}

}  // namespace slabd::web
