// SPDX-License-Identifier: Apache-2.0
#include "web/server.h"

#include <arpa/inet.h>
#include <microhttpd.h>
#include <netinet/in.h>
#include <sys/socket.h>

#include <array>
#include <charconv>
#include <optional>
#include <utility>
#include <vector>

#include "base/os.h"

namespace slabd::web {
namespace {

constexpr std::size_t kThreadStackBytes = 262'144;
/// Longest wait for an answer: three time limits of a report of 60 s, and some reserve.
constexpr unsigned kSlow_s = 1'200;

/// TLS 1.2 and 1.3 (priority string of GnuTLS).
constexpr const char* kTlsPriorities = "SECURE128:-VERS-ALL:+VERS-TLS1.3:+VERS-TLS1.2";

/// A script of another origin cannot run in the page, frame it, or read its documents.
constexpr std::array<std::pair<const char*, const char*>, 5> kSecurityFields = {
    {{"Content-Security-Policy",
      "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; connect-src 'self'; "
      "require-trusted-types-for 'script'; trusted-types 'none'; frame-ancestors 'none'; base-uri 'none'; "
      "form-action 'self'"},
     {"X-Content-Type-Options", "nosniff"},
     {"Referrer-Policy", "no-referrer"},
     {"Cross-Origin-Resource-Policy", "same-origin"},
     {"Cross-Origin-Opener-Policy", "same-origin"}}};

/// One request between its first line and its end.
struct Exchange {
  std::string target;
  bool is_begun = false;
  std::string body;  ///< of a POST, as far as it has come
  bool is_too_long = false;
};

/// Keeps an answer while libmicrohttpd sends its text.
void release_answer(void* kept) {
  delete static_cast<SharedAnswer*>(kept);
}

MHD_Response* response_of(const HttpReply& reply) {
  const Answer& answer = *reply.answer;
  if (reply.status == 304) return MHD_create_response_from_buffer(0, nullptr, MHD_RESPMEM_PERSISTENT);
  if (answer.file.is_open()) {
    const int file = ::fcntl(answer.file.get(), F_DUPFD_CLOEXEC, 0);  // closed with the response
    return file < 0 ? nullptr : MHD_create_response_from_fd64(answer.bytes, file);
  }
  auto* const kept = new SharedAnswer(reply.answer);
  MHD_Response* const response = MHD_create_response_from_buffer_with_free_callback_cls(
      answer.text.size(), const_cast<char*>(answer.text.data()), &release_answer, kept);  // NOLINT: it only reads
  if (response == nullptr) delete kept;
  return response;
}

MHD_Result send(MHD_Connection* connection, const HttpReply& reply) {
  MHD_Response* const response = response_of(reply);
  if (response == nullptr) return MHD_NO;
  for (const auto& [name, value] : kSecurityFields) MHD_add_response_header(response, name, value);
  MHD_add_response_header(response, MHD_HTTP_HEADER_CACHE_CONTROL, reply.may_keep ? "no-cache" : "no-store");
  if (reply.may_keep && !reply.answer->etag.empty())
    MHD_add_response_header(response, MHD_HTTP_HEADER_ETAG, reply.answer->etag.c_str());
  if (reply.status != 304) MHD_add_response_header(response, MHD_HTTP_HEADER_CONTENT_TYPE, reply.answer->type.c_str());
  if (reply.answer->type == "application/pdf")
    MHD_add_response_header(response, MHD_HTTP_HEADER_CONTENT_DISPOSITION, "inline; filename=\"report.pdf\"");
  if (reply.status == 405) MHD_add_response_header(response, MHD_HTTP_HEADER_ALLOW, "GET, HEAD, POST");
  if (!reply.set_cookie.empty())
    MHD_add_response_header(response, MHD_HTTP_HEADER_SET_COOKIE, reply.set_cookie.c_str());
  if (reply.retry_after_s > 0)
    MHD_add_response_header(response, MHD_HTTP_HEADER_RETRY_AFTER, std::to_string(reply.retry_after_s).c_str());
  if (reply.status == 503) MHD_add_response_header(response, MHD_HTTP_HEADER_RETRY_AFTER, "2");
  const MHD_Result queued = MHD_queue_response(connection, static_cast<unsigned>(reply.status), response);
  MHD_destroy_response(response);
  return queued;
}

std::string_view field(MHD_Connection* connection, const char* name) {
  const char* const value = MHD_lookup_connection_value(connection, MHD_HEADER_KIND, name);
  return value == nullptr ? std::string_view() : std::string_view(value);
}

/// The IPv4 address of one side of the connection: getsockname for this computer, getpeername for the browser.
template <typename Call>
std::string address_of(MHD_Connection* connection, Call&& call) {
  const MHD_ConnectionInfo* const info = MHD_get_connection_info(connection, MHD_CONNECTION_INFO_CONNECTION_FD);
  sockaddr_in address{};
  socklen_t bytes = sizeof address;
  std::array<char, INET_ADDRSTRLEN> text{};
  if (info == nullptr || call(info->connect_fd, static_cast<sockaddr*>(static_cast<void*>(&address)), &bytes) != 0 ||
      ::inet_ntop(AF_INET, &address.sin_addr, text.data(), text.size()) == nullptr)
    return {};
  return text.data();
}

MHD_Result handle(Site& site, bool is_tls, MHD_Connection* connection, const char* method, Exchange& exchange) {
  const bool is_slow = Site::is_slow(exchange.target);
  // The time limit also counts while the answer is made.
  MHD_set_connection_option(connection, MHD_CONNECTION_OPTION_TIMEOUT, is_slow ? kSlow_s : kIdle_s);
  const std::string address = address_of(connection, ::getsockname);
  const std::string peer = address_of(connection, ::getpeername);
  HttpRequest request;
  request.method = method;
  request.target = exchange.target;
  request.host = field(connection, MHD_HTTP_HEADER_HOST);
  request.if_none_match = field(connection, MHD_HTTP_HEADER_IF_NONE_MATCH);
  request.accept_language = field(connection, MHD_HTTP_HEADER_ACCEPT_LANGUAGE);
  const std::string_view length = field(connection, MHD_HTTP_HEADER_CONTENT_LENGTH);
  request.has_body =
      (!length.empty() && length != "0") || !field(connection, MHD_HTTP_HEADER_TRANSFER_ENCODING).empty();
  request.local_address = address;
  request.peer_address = peer;
  request.is_tls = is_tls;
  request.cookie = field(connection, MHD_HTTP_HEADER_COOKIE);
  request.origin = field(connection, MHD_HTTP_HEADER_ORIGIN);
  request.fetch_site = field(connection, "Sec-Fetch-Site");
  request.content_type = field(connection, MHD_HTTP_HEADER_CONTENT_TYPE);
  request.body = exchange.body;
  request.is_too_long = exchange.is_too_long;
  const MHD_Result sent = send(connection, site.reply(request));
  if (is_slow) MHD_set_connection_option(connection, MHD_CONNECTION_OPTION_TIMEOUT, 2 * kIdle_s);
  return sent;
}

// The functions that libmicrohttpd calls. No exception may leave them.

void* begin_request(void*, const char* target, MHD_Connection*) {
  try {
    return new Exchange{target, false, {}, false};
  } catch (...) {
    return nullptr;
  }
}

void end_request(void*, MHD_Connection*, void** context, MHD_RequestTerminationCode) {
  delete static_cast<Exchange*>(*context);
  *context = nullptr;
}

/// Length of the body of a POST; nullopt if it is not given, or longer than kBodyBytesMax.
std::optional<std::size_t> body_bytes(MHD_Connection* connection) {
  const std::string_view length = field(connection, MHD_HTTP_HEADER_CONTENT_LENGTH);
  std::size_t bytes = 0;
  const auto [end, fault] = std::from_chars(length.data(), length.data() + length.size(), bytes);
  const bool is_number = fault == std::errc() && end == length.data() + length.size() && !length.empty();
  if (!is_number || bytes > kBodyBytesMax || !field(connection, MHD_HTTP_HEADER_TRANSFER_ENCODING).empty())
    return std::nullopt;
  return bytes;
}

/// Takes the body of a POST piece by piece; true when it is complete.
bool take_body(Exchange& exchange, const char* piece, std::size_t* piece_bytes) {
  if (*piece_bytes == 0) return true;
  const std::size_t room = kBodyBytesMax - exchange.body.size();
  exchange.body.append(piece, std::min(room, *piece_bytes));
  *piece_bytes = 0;
  return false;
}

MHD_Result answer_request(void* of, MHD_Connection* connection, const char*, const char* method, const char*,
                          const char* piece, std::size_t* upload_bytes, void** context) {
  auto* const exchange = static_cast<Exchange*>(*context);
  if (exchange == nullptr) return MHD_NO;
  const Listener::Context& listener = *static_cast<Listener::Context*>(of);
  try {
    if (std::string_view(method) == "POST") {
      if (!exchange->is_begun) {
        exchange->is_begun = true;
        if (body_bytes(connection)) return MHD_YES;
        // Answered before the body is read, which closes the connection.
        *upload_bytes = 0;
        exchange->is_too_long = true;
        return handle(listener.site, listener.is_tls, connection, method, *exchange);
      }
      if (!take_body(*exchange, piece, upload_bytes)) return MHD_YES;
      return handle(listener.site, listener.is_tls, connection, method, *exchange);
    }
    *upload_bytes = 0;
    const std::string_view wanted(method);
    const bool may_wait = wanted == "GET" || wanted == "HEAD";
    // The first call comes before a body is read. An answer to it closes the connection after a request with a body.
    if (may_wait && !exchange->is_begun && field(connection, MHD_HTTP_HEADER_CONTENT_LENGTH).empty() &&
        field(connection, MHD_HTTP_HEADER_TRANSFER_ENCODING).empty()) {
      exchange->is_begun = true;
      return MHD_YES;
    }
    return handle(listener.site, listener.is_tls, connection, method, *exchange);
  } catch (...) {
    return MHD_NO;
  }
}

/// Leaves the target as it was sent; target.h decodes it.
std::size_t keep_escapes(void*, MHD_Connection*, char* text) {
  return std::string_view(text).size();
}

Error not_open(const ListenerSettings& settings, const char* why) {
  return error(Code::config, "%s:%u: %s; does another program listen there, is it an address of this computer?",
               settings.host.c_str(), unsigned{settings.port}, why);
}

/// A listening socket. libmicrohttpd would not report the port that the kernel chose.
Result<Fd> listening_socket(const ListenerSettings& settings, std::uint16_t& port, bool& has_address) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(settings.port);
  if (::inet_pton(AF_INET, settings.host.c_str(), &address.sin_addr) != 1)
    return not_open(settings, "not an IPv4 address");
  Fd socket(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
  const int on = 1;
  ::setsockopt(socket.get(), SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
  auto* const place = static_cast<sockaddr*>(static_cast<void*>(&address));
  socklen_t bytes = sizeof address;
  bool is_bound = socket.is_open() && ::bind(socket.get(), place, bytes) == 0;
  has_address = is_bound || errno != EADDRNOTAVAIL || !settings.waits_for_address;
  if (!has_address) {
    // A network card without a cable or an address must not stop the other listener, the kiosk.
    ::setsockopt(socket.get(), IPPROTO_IP, IP_FREEBIND, &on, sizeof on);
    is_bound = ::bind(socket.get(), place, bytes) == 0;
  }
  if (!is_bound || ::listen(socket.get(), 64) != 0 || ::getsockname(socket.get(), place, &bytes) != 0)
    return not_open(settings, errno_text(errno));
  port = ntohs(address.sin_port);
  return socket;
}

}  // namespace

Result<std::unique_ptr<Listener>> Listener::open(const ListenerSettings& settings, Site& site) {
  std::unique_ptr<Listener> listener(new Listener(settings, site));
  auto socket = listening_socket(settings, listener->port_, listener->has_address_);
  if (!socket) return socket.error();
  const auto function = [](auto* call) { return reinterpret_cast<std::intptr_t>(call); };
  const auto text = [](const std::string& pem) { return const_cast<char*>(pem.c_str()); };  // NOLINT: it only reads
  std::vector<MHD_OptionItem> options = {{MHD_OPTION_LISTEN_SOCKET, socket.value().get(), nullptr},
                                         {MHD_OPTION_CONNECTION_LIMIT, kConnectionsMax, nullptr},
                                         {MHD_OPTION_PER_IP_CONNECTION_LIMIT, settings.per_address_max, nullptr},
                                         {MHD_OPTION_CONNECTION_MEMORY_LIMIT, kConnectionBytesMax, nullptr},
                                         {MHD_OPTION_CONNECTION_TIMEOUT, kIdle_s, nullptr},
                                         {MHD_OPTION_THREAD_STACK_SIZE, kThreadStackBytes, nullptr},
                                         {MHD_OPTION_STRICT_FOR_CLIENT, 1, nullptr},
                                         {MHD_OPTION_URI_LOG_CALLBACK, function(&begin_request), nullptr},
                                         {MHD_OPTION_UNESCAPE_CALLBACK, function(&keep_escapes), nullptr},
                                         {MHD_OPTION_NOTIFY_COMPLETED, function(&end_request), nullptr}};
  unsigned flags = MHD_USE_INTERNAL_POLLING_THREAD | MHD_USE_THREAD_PER_CONNECTION | MHD_USE_POLL;
  if (settings.is_tls) {
    flags |= MHD_USE_TLS;
    options.push_back({MHD_OPTION_HTTPS_MEM_CERT, 0, text(listener->settings_.certificate)});
    options.push_back({MHD_OPTION_HTTPS_MEM_KEY, 0, text(listener->settings_.key)});
    options.push_back({MHD_OPTION_HTTPS_PRIORITIES, 0, const_cast<char*>(kTlsPriorities)});  // NOLINT: it only reads
  }
  options.push_back({MHD_OPTION_END, 0, nullptr});
  listener->daemon_ = MHD_start_daemon(flags, 0, nullptr, nullptr, &answer_request, &listener->context_,
                                       MHD_OPTION_ARRAY, options.data(), MHD_OPTION_END);
  if (listener->daemon_ == nullptr)
    return not_open(settings, settings.is_tls ? "tls_cert and tls_key are not a PEM certificate and its key"
                                              : "the HTTP library does not start");
  static_cast<void>(socket.value().release());  // closed by the library
  return listener;
}

Listener::~Listener() {
  if (daemon_ != nullptr) MHD_stop_daemon(daemon_);
}

}  // namespace slabd::web
