// SPDX-License-Identifier: Apache-2.0
#include "web/site.h"

#include <fmt/core.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "base/plain_text.h"
#include "report/json.h"
#include "web/assets.h"
#include "web/words.h"

namespace slabd::web {
namespace {

using nlohmann::json;

constexpr std::string_view kApi = "/api/";
constexpr std::string_view kAssets = "/assets/";
constexpr std::string_view kCookie = "slabd_session";

/// The document of an answer as a part of another document.
std::string part_of(const Answer& answer) {
  std::string text = answer.status == 200 ? body_of(answer) : "null";
  while (text.ends_with('\n')) text.pop_back();
  return text;
}

/// slabd.web_error/1 with cause and cure in Chinese, as far as the catalogue has them.
SharedAnswer error_in_chinese(const Answer& english) {
  const json document = json::parse(body_of(english), nullptr, false);
  if (!document.is_object()) return error_answer(english.status, body_of(english), "");
  return error_answer(english.status, sentence_in_chinese(document.value("text", "")),
                      sentence_in_chinese(document.value("cure", "")));
}

HttpReply refusal(int status, const std::string& text, const std::string& cure) {
  return {status, error_answer(status, text, cure)};
}

/// The texts of a JSON object; nullopt if it is not one, or if another value is in it.
std::optional<Fields> fields_of(std::string_view body) {
  const json parsed = json::parse(body, nullptr, false);
  if (!parsed.is_object()) return std::nullopt;
  Fields fields;
  for (const auto& [name, value] : parsed.items()) {
    if (!value.is_string()) return std::nullopt;
    fields[name] = value.get<std::string>();
  }
  return fields;
}

/// True if the page that sends a request is of this server. A browser sends Origin with every POST, and another page
/// cannot change it (Fetch standard, 3.1).
bool is_same_origin(const HttpRequest& request) {
  if (request.origin.empty()) return request.fetch_site == "same-origin";
  return request.origin == std::string(request.is_tls ? "https://" : "http://") + std::string(request.host);
}

/// A password is not sent over a network in clear text.
bool may_carry_password(const HttpRequest& request) {
  return request.is_tls || request.local_address.starts_with("127.");
}

std::string cookie_field(const HttpRequest& request, std::string_view token, std::int64_t lasts_s) {
  return fmt::format("{}={}; Path=/; HttpOnly; SameSite=Strict; Max-Age={}{}", kCookie, token, lasts_s,
                     request.is_tls ? "; Secure" : "");
}

void log(const HttpRequest& request, const std::string& sentence) {
  fmt::print(stderr, "slabd-web: {}: {}\n", request.peer_address, plain(sentence));
}

std::int64_t seconds_until(SessionClock::time_point end) {
  return std::chrono::duration_cast<std::chrono::seconds>(end - SessionClock::now()).count();
}

DocumentOrder order_of(const Request& request) {
  const Route& route = *request.route;
  return {.arguments = request.arguments,
          .cache_s = route.cache_s,
          .renew_s = route.renew_s,
          .is_report = route.maker == Maker::report,
          .is_plant = route.maker == Maker::plant,
          .file_type = route.path.ends_with(".png") ? "image/png" : "application/pdf"};
}

/// Documents of many slabs that take seconds, as the pages ask for them.
std::vector<DocumentOrder> slow_documents() {
  std::vector<DocumentOrder> orders;
  for (const char* target : {"/api/v1/moulds", "/api/v1/reasons?since=31d"})
    if (const auto parsed = parse_target(target)) {
      const auto found = find_document(*parsed);
      if (const auto* const request = std::get_if<Request>(&found)) orders.push_back(order_of(*request));
    }
  return orders;
}

}  // namespace

Site::Site(SiteSettings settings, Documents& documents, Live& live)
    : settings_(std::move(settings)),
      documents_(documents),
      live_(live),
      sessions_(settings_.users_file),
      words_en_(text_answer(words_document("en"), "application/json")),
      words_zh_(text_answer(words_document("zh"), "application/json")) {
  for (const Asset& asset : assets())
    files_.emplace_back(asset.name, text_answer(std::string(asset.bytes), std::string(media_type(asset.name))));
  documents_.make_ahead(slow_documents());
}

bool Site::is_known_host(const HttpRequest& request) const {
  return is_host(request.host, settings_.names) ||
         is_host(request.host, {"localhost", "127.0.0.1", std::string(request.local_address)});
}

SharedAnswer Site::calibration(double cache_s, bool in_chinese) {
  const std::string state = live_.calibration();
  const SharedAnswer history = documents_.get({.arguments = {"calibrate", "history", "--json"}, .cache_s = cache_s});
  const std::vector<std::string>& scanners = settings_.scanners;
  const bool several = scanners.size() > 1;
  const std::string trend = checks_of(several ? scanners.front() : "", cache_s);
  const bool is_state = state.find("\"slabd.calibration_state/1\"") != std::string::npos;
  const auto part = [&](const std::string& text) { return in_chinese ? notes_in_chinese(text) : text; };
  std::string further;
  for (std::size_t i = 1; i < scanners.size(); ++i)
    further += fmt::format("{}{{\"scanner\":\"{}\",\"trend\":{}}}", further.empty() ? "" : ",", scanners[i],
                           part(checks_of(scanners[i], cache_s)));
  return text_answer("{\"schema\":\"slabd.web_calibration/1\",\"state\":" + part(is_state ? state : "null") +
                         ",\"history\":" + part(part_of(*history)) + ",\"trend\":" + part(trend) +
                         ",\"further_trends\":[" + further + "]}\n",
                     "application/json");
}

/// Checks of one scanner; of the only one if the id is empty. Ids consist of letters, digits, '-' and '_'.
std::string Site::checks_of(const std::string& scanner, double cache_s) {
  DocumentOrder order{{"calibrate", "check", "--json"}, cache_s};
  if (!scanner.empty()) order.arguments.push_back("--scanner=" + scanner);
  return part_of(*documents_.get(order));
}

SharedAnswer Site::document(const HttpRequest& asked, const Target& target) {
  auto found = find_document(target);
  if (const Refusal* const refusal = std::get_if<Refusal>(&found))
    return error_answer(refusal->status, refusal->text, refusal->cure);
  const Request& request = *std::get_if<Request>(&found);
  switch (request.route->maker) {
    case Maker::status: return live_.answer(request.language);
    case Maker::session: return session_document(asked, session_of(asked));
    case Maker::words: return request.language == "zh" ? words_zh_ : words_en_;
    case Maker::calibration: return calibration(request.route->cache_s, request.language == "zh");
    case Maker::slabctl:
    case Maker::plant:
    case Maker::report: break;
  }
  return documents_.get(order_of(request));
}

SharedAnswer Site::find(const HttpRequest& request, const Target& target) {
  const std::string& path = target.path;
  if (path.starts_with(kApi)) return document(request, target);
  if (path == "/healthz") return text_answer("ok\n", "text/plain; charset=utf-8");
  const std::string_view name = path.starts_with(kAssets) ? std::string_view(path).substr(kAssets.size())
                                : is_page(path)           ? "index.html"
                                                          : "";
  const auto file = std::find_if(files_.begin(), files_.end(), [&](const auto& one) { return one.first == name; });
  if (file == files_.end()) return error_answer(404, "no page is at this path", "the pages begin at /");
  return file->second;
}

// ---- logins ------------------------------------------------------------------------------------------------------

std::optional<Session> Site::session_of(const HttpRequest& request) {
  return sessions_.find(cookie_in(request.cookie, kCookie), SessionClock::now());
}

bool Site::needs_login(std::string_view path) const {
  return settings_.viewer_login && path.starts_with(kApi) && path != "/api/v1/session" && path != "/api/v1/words";
}

SharedAnswer Site::session_document(const HttpRequest& request, const std::optional<Session>& session) const {
  report::Json json("slabd.web_session/1");
  json.field("user", session ? std::optional(session->user) : std::nullopt)
      .field("role", session ? std::optional(session->role) : std::nullopt)
      .field("may_login", sessions_.are_possible() && may_carry_password(request))
      .field("login_required", settings_.viewer_login && !session)
      .field("may_write", session && session->role == config::WebRole::quality)
      .field("second_person", settings_.second_person)
      .field("plant", settings_.plant)
      .field("expires_s", session ? std::optional(seconds_until(session->ends)) : std::nullopt);
  return text_answer(json.text(), "application/json");
}

HttpReply Site::log_in(const HttpRequest& request, const Fields& fields) {
  using End = Sessions::LoginResult::End;
  if (!sessions_.are_possible()) return refusal(403, "no user can log in here", "[web] users_file names the accounts");
  if (!may_carry_password(request))
    return refusal(403, "a password is not sent over a connection without TLS",
                   "use the address of the kiosk on the line PC, or give lan_listen a certificate");
  const auto name = fields.find("name");
  const auto password = fields.find("password");
  if (fields.size() != 2 || name == fields.end() || password == fields.end())
    return refusal(400, "a login has name and password", "send both and nothing else");
  const Sessions::LoginResult result =
      sessions_.log_in(name->second, password->second, std::string(request.peer_address), SessionClock::now());
  switch (result.end) {
    case End::too_often: {
      HttpReply reply = refusal(429, "too many wrong passwords", "wait");
      reply.retry_after_s = result.wait.count();
      return reply;
    }
    case End::busy: return refusal(503, "too many logins at once", "try again in some seconds");
    case End::no_users:
      log(request, "no user can log in: " + result.trouble);
      return refusal(503, "the accounts cannot be read", "journalctl -u slabd-web; slabctl web user list");
    case End::wrong:
      log(request, "wrong password for \"" + name->second.substr(0, 64) + "\"");
      return refusal(401, "name or password is wrong", "slabctl web user password sets a new one");
    case End::logged_in: break;
  }
  log(request, result.session.user + " logged in");
  HttpReply reply{200, session_document(request, result.session)};
  reply.set_cookie = cookie_field(request, result.token, seconds_until(result.session.ends));
  return reply;
}

HttpReply Site::log_out(const HttpRequest& request) {
  if (const std::optional<Session> session = session_of(request)) log(request, session->user + " logged out");
  sessions_.log_out(cookie_in(request.cookie, kCookie));
  HttpReply reply{200, session_document(request, std::nullopt)};
  reply.set_cookie = cookie_field(request, "", 0);
  return reply;
}

// ---- writes ------------------------------------------------------------------------------------------------------

HttpReply Site::change(const HttpRequest& request, const WriteRequest& wanted, const Fields& fields) {
  const std::optional<Session> session = session_of(request);
  if (!session) return refusal(401, "no user is logged in", "log in");
  if (session->role != config::WebRole::quality)
    return refusal(403, session->user + " may read and not decide", "slabctl web user add --role quality");
  std::vector<std::string> arguments;
  std::vector<std::string_view> allowed;
  if (wanted.write == Write::disposition) {
    arguments = {"disposition", "--operator=" + session->user + " (page)"};
    allowed = {"decision", "reason", "authority", "second"};
  } else if (wanted.write == Write::pin) {
    arguments = {"pin", "--operator=" + session->user + " (page)"};
    allowed = {"reason"};
  } else {
    arguments = {"unpin", "--operator=" + session->user + " (page)"};
  }
  for (const auto& [name, value] : fields) {
    if (std::find(allowed.begin(), allowed.end(), name) == allowed.end() || !is_plain(value))
      return refusal(400, "field \"" + plain(name) + "\" is not known here, or is not one line of text",
                     "docs/WEB.md lists the fields");
    if (!value.empty()) arguments.push_back("--" + name + "=" + value);
  }
  arguments.emplace_back("--");
  arguments.push_back(wanted.key);
  HttpReply reply;
  reply.answer = documents_.carry_out(arguments);
  reply.status = reply.answer->status;
  const std::string_view verb = wanted.write == Write::disposition ? "disposition of"
                                : wanted.write == Write::pin       ? "pin of"
                                                                   : "unpin of";
  log(request, fmt::format("{}: {} slab {}: {}", session->user, verb, wanted.key,
                           reply.status == 200 ? "done" : body_of(*reply.answer)));
  return reply;
}

HttpReply Site::write(const HttpRequest& request) {
  const std::optional<Target> target = parse_target(request.target);
  const std::optional<WriteRequest> wanted = target ? find_write(*target) : std::nullopt;
  if (!wanted || !target->parameters.empty())
    return refusal(405, "nothing is written at this path", "docs/WEB.md lists what is");
  if (request.is_too_long)
    return refusal(413, "the body is longer than 8192 bytes, or its length is not given", "send Content-Length");
  if (!is_same_origin(request)) return refusal(403, "this request is of another page", "use the page of slabd-web");
  if (request.content_type != "application/json")
    return refusal(415, "the body is not application/json", "send a JSON object");
  const std::optional<Fields> fields = fields_of(request.body);
  if (!fields) return refusal(400, "the body is not a JSON object of texts", "docs/WEB.md lists the fields");
  if (wanted->write == Write::login) return log_in(request, *fields);
  if (wanted->write == Write::logout) return log_out(request);
  return change(request, *wanted, *fields);
}

HttpReply Site::read(const HttpRequest& request) {
  const std::optional<Target> target = parse_target(request.target);
  if (!target) return refusal(400, "the address is not one of this program", "docs/WEB.md lists the paths");
  if (needs_login(target->path) && !session_of(request)) return refusal(401, "no user is logged in", "log in");
  HttpReply reply;
  reply.answer = find(request, *target);
  reply.status = reply.answer->status;
  reply.may_keep = reply.status == 200;
  if (reply.may_keep && has_etag(request.if_none_match, reply.answer->etag)) reply.status = 304;
  return reply;
}

HttpReply Site::reply(const HttpRequest& request) {
  HttpReply reply = in_english(request);
  if (reply.status >= 400 && request.accept_language.starts_with("zh")) reply.answer = error_in_chinese(*reply.answer);
  return reply;
}

HttpReply Site::in_english(const HttpRequest& request) {
  const bool writes = request.method == "POST";
  if (!writes && request.method != "GET" && request.method != "HEAD")
    return refusal(405, "only GET, HEAD and POST are answered", "docs/WEB.md lists what is read and written");
  if (!writes && request.has_body) return refusal(400, "a request has no body here", "send none");
  if (!is_known_host(request))
    return refusal(421, "this name does not belong to this computer", "add it to [web] names");
  return writes ? write(request) : read(request);
}

bool Site::is_slow(std::string_view target) {
  return target.starts_with(kApi) && !target.starts_with("/api/v1/status");
}

}  // namespace slabd::web
