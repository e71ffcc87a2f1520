// SPDX-License-Identifier: Apache-2.0
#include "emulator/gauge_peer.h"

#include <arpa/inet.h>
#include <fmt/core.h>
#include <modbus.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <bit>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "base/os.h"
#include "base/prng.h"
#include "emulator/slab_scene.h"

namespace slabd::emulator {
namespace {

constexpr std::uint64_t kGaugeStream = 41;
/// Scatter of a good slab: a dimension, and the height of a corner of the bottom.
constexpr double kCasting_mm = 0.3;
constexpr double kBottom_mm = 0.1;
/// Reading of a sensor whose place is not the zero of the dimension: the middle of its measuring range.
double middle(const GaugeSettings& gauge) {
  return gauge.has_range() ? 0.5 * (gauge.low + gauge.high) : 0.0;
}

struct MappingFree {
  void operator()(modbus_mapping_t* mapping) const { modbus_mapping_free(mapping); }
};
struct ModbusFree {
  void operator()(modbus_t* context) const { modbus_free(context); }
};

/// One Modbus/TCP server with any number of instruments. One connection at a time.
class Instrument {
 public:
  Instrument(std::string host, std::uint16_t port) : host_(std::move(host)), port_(port) {}
  ~Instrument() {
    stop_ = true;
    if (server_.joinable()) server_.join();
  }
  Instrument(const Instrument&) = delete;
  Instrument& operator=(const Instrument&) = delete;

  [[nodiscard]] bool is_at(const GaugeSettings& gauge) const { return gauge.host == host_ && gauge.port == port_; }
  [[nodiscard]] Status open() {
    context_.reset(modbus_new_tcp(host_.c_str(), port_));
    listener_ = Fd(context_ == nullptr ? -1 : modbus_tcp_listen(context_.get(), 1));
    if (!listener_.is_open())
      return error(Code::config, "the emulated instrument cannot listen at %s:%u: %s", host_.c_str(), unsigned{port_},
                   modbus_strerror(errno));
    server_ = std::thread([this] { serve(); });
    return success();
  }
  void show(const GaugeSettings& gauge, double number) {
    const std::lock_guard lock(mutex_);
    std::uint16_t* const at =
        (gauge.input_register ? memory_->tab_input_registers : memory_->tab_registers) + gauge.address;
    if (registers_of(gauge.format) == 1) {
      at[0] = static_cast<std::uint16_t>(std::lround(number));
      return;
    }
    const std::uint32_t word = gauge.format == GaugeFormat::f32
                                   ? std::bit_cast<std::uint32_t>(static_cast<float>(number))
                                   : static_cast<std::uint32_t>(std::llround(number));
    at[gauge.low_word_first ? 1 : 0] = static_cast<std::uint16_t>(word >> 16U);
    at[gauge.low_word_first ? 0 : 1] = static_cast<std::uint16_t>(word & 0xFFFFU);
  }

 private:
  void serve() {
    Fd peer;
    while (!stop_) {
      std::array<pollfd, 2> ready = {pollfd{listener_.get(), POLLIN, 0}, pollfd{peer.get(), POLLIN, 0}};
      if (::poll(ready.data(), ready.size(), 50) <= 0) continue;
      if ((ready[0].revents & POLLIN) != 0) {
        peer = Fd(::accept4(listener_.get(), nullptr, nullptr, SOCK_CLOEXEC));
      } else if (ready[1].revents != 0) {
        std::array<std::uint8_t, MODBUS_TCP_MAX_ADU_LENGTH> request{};
        modbus_set_socket(context_.get(), peer.get());
        const int bytes = modbus_receive(context_.get(), request.data());
        const std::lock_guard lock(mutex_);
        if (bytes < 0 || (bytes > 0 && modbus_reply(context_.get(), request.data(), bytes, memory_.get()) < 0))
          peer.reset();
      }
    }
  }

  std::string host_;
  std::uint16_t port_;
  std::unique_ptr<modbus_t, ModbusFree> context_;
  std::unique_ptr<modbus_mapping_t, MappingFree> memory_{modbus_mapping_new(0, 0, 65'536, 65'536)};
  std::mutex mutex_;
  Fd listener_;
  std::atomic<bool> stop_{false};
  std::thread server_;
};

}  // namespace

Result<GaugeFault> parse_gauge_fault(std::string_view text, const GaugeList& gauges) {
  GaugeFault fault;
  if (text.empty()) return fault;
  using Kind = GaugeFault::Kind;
  struct Word {
    std::string_view word;
    Kind kind;
  };
  static constexpr std::array<Word, 6> kWords = {{{"stuck", Kind::stuck},
                                                  {"swapped", Kind::swapped},
                                                  {"late", Kind::late},
                                                  {"unit", Kind::unit},
                                                  {"previous", Kind::previous},
                                                  {"missing", Kind::missing}}};
  const std::size_t equals = text.find('=');
  for (const Word& word : kWords)
    if (word.word == text.substr(0, equals)) fault.kind = word.kind;
  std::string_view names = equals == std::string_view::npos ? std::string_view() : text.substr(equals + 1);
  const std::size_t comma = names.find(',');
  fault.gauge = GaugeName(names.substr(0, comma));
  if (comma != std::string_view::npos) fault.other = GaugeName(names.substr(comma + 1));
  const auto is_gauge = [&](const GaugeName& name) {
    return std::any_of(gauges.begin(), gauges.end(), [&](const GaugeSettings& gauge) { return gauge.name == name; });
  };
  const bool pair = fault.kind == Kind::swapped;
  if (fault.kind == Kind::none || !is_gauge(fault.gauge) || is_gauge(fault.other) != pair)
    return error(
        Code::config,
        "--gauge-fault %.*s: allowed is stuck, late, unit, previous or missing=NAME, or swapped=NAME,NAME, with "
        "names of [[gauge]]",
        static_cast<int>(std::min<std::size_t>(text.size(), 80)), text.data());
  return fault;
}

struct GaugePeer::Impl {
  GaugeList gauges;
  Recipe recipe;
  GaugeFault fault;
  std::uint64_t seed = 0;
  std::vector<std::unique_ptr<Instrument>> instruments;
  Fd socket;
  std::array<double, limits::kGaugesMax> truth{};
  std::array<double, limits::kGaugesMax> first{};
  bool has_first = false;
  /// Starts at the time, so that a second run does not repeat the numbers of the first.
  std::uint32_t seq = static_cast<std::uint32_t>(
      std::chrono::duration_cast<std::chrono::seconds>(std::chrono::system_clock::now().time_since_epoch()).count());
  std::uint16_t late_port = 0;
  std::string late_line;

  [[nodiscard]] bool is_at_fault(const GaugeSettings& gauge, GaugeFault::Kind kind) const {
    return fault.kind == kind && fault.gauge == gauge.name;
  }
  [[nodiscard]] std::size_t index_of(const GaugeName& name) const {
    for (std::size_t i = 0; i < gauges.size(); ++i)
      if (gauges[i].name == name) return i;
    return 0;
  }

  /// True readings of all gauges for this slab.
  void cast(std::uint32_t slab_no) {
    Prng random(derived_seed(seed, kGaugeStream, slab_no));
    truth.fill(0.0);
    for (const ItemId id : kGaugeItemIds) {
      const GaugeFormula& formula = recipe.formula(id);
      const double nominal = recipe.tolerance(id).nominal.value;
      const double dimension = (has_value(nominal) ? nominal : 0.0) + kCasting_mm * random.normal();
      for (std::size_t i = 0; i < formula.gauges.size(); ++i) {
        const std::size_t gauge = index_of(formula.gauges[i]);
        switch (formula.kind) {
          case FormulaKind::none: break;
          case FormulaKind::mean: truth[gauge] = dimension + gauges[gauge].u * random.normal(); break;
          case FormulaKind::difference: truth[gauge] = middle(gauges[gauge]) + (i == 0 ? dimension : 0.0); break;
          case FormulaKind::range:
          case FormulaKind::plane4_flatness: truth[gauge] = middle(gauges[gauge]) + kBottom_mm * random.normal(); break;
        }
      }
    }
    if (!has_first) first = truth;
    has_first = true;
  }

  /// Reading of a gauge with its fault.
  [[nodiscard]] double reading(std::size_t i) const {
    if (fault.kind == GaugeFault::Kind::swapped) {
      if (gauges[i].name == fault.gauge) return truth[index_of(fault.other)];
      if (gauges[i].name == fault.other) return truth[index_of(fault.gauge)];
    }
    if (is_at_fault(gauges[i], GaugeFault::Kind::stuck)) return first[i];
    if (is_at_fault(gauges[i], GaugeFault::Kind::unit)) return truth[i] / kMmPerM;
    return truth[i];
  }

  void send(std::uint16_t port, const std::string& line) const {
    sockaddr_in to{};
    to.sin_family = AF_INET;
    to.sin_port = htons(port);
    to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    static_cast<void>(
        ::sendto(socket.get(), line.data(), line.size(), 0, reinterpret_cast<const sockaddr*>(&to), sizeof to));
  }
};

GaugePeer::GaugePeer(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
GaugePeer::~GaugePeer() = default;

Result<std::unique_ptr<GaugePeer>> GaugePeer::start(const GaugeList& gauges, const Recipe& recipe,
                                                    const GaugeFault& fault, std::uint64_t seed) {
  auto impl = std::make_unique<Impl>();
  impl->gauges = gauges;
  impl->recipe = recipe;
  impl->fault = fault;
  impl->seed = seed;
  impl->socket = Fd(::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  for (const GaugeSettings& gauge : gauges) {
    if (gauge.link != GaugeLink::modbus) continue;
    const bool known = std::any_of(impl->instruments.begin(), impl->instruments.end(),
                                   [&](const auto& instrument) { return instrument->is_at(gauge); });
    if (known) continue;
    impl->instruments.push_back(std::make_unique<Instrument>(std::string(gauge.host.view()), gauge.port));
    if (const Status opened = impl->instruments.back()->open(); !opened.ok()) return opened.error();
  }
  return std::unique_ptr<GaugePeer>(new GaugePeer(std::move(impl)));
}

PlcGauges GaugePeer::measure(std::uint32_t slab_no) {
  Impl& it = *impl_;
  it.cast(slab_no);
  ++it.seq;
  it.late_line.clear();
  PlcGauges plc;
  plc.slab_no = slab_no;
  plc.thousandths.fill(kNoGaugeRegister);
  for (std::size_t i = 0; i < it.gauges.size(); ++i) {
    const GaugeSettings& gauge = it.gauges[i];
    const bool late = it.is_at_fault(gauge, GaugeFault::Kind::late);
    const bool missing = it.is_at_fault(gauge, GaugeFault::Kind::missing);
    const bool previous = it.is_at_fault(gauge, GaugeFault::Kind::previous);
    const std::uint32_t before = slab_no > 1 ? slab_no - 1 : slab_no + 1;  // 0 names no slab
    const std::uint32_t names = previous ? before : slab_no;
    const double number = it.reading(i) / gauge.scale;
    if (gauge.link == GaugeLink::plc) {
      plc.any = true;
      plc.late = plc.late || late;
      if (previous) plc.slab_no = names;
      if (!missing) plc.thousandths[gauge.plc_index] = static_cast<std::int32_t>(std::lround(1e3 * number));
    } else if (gauge.link == GaugeLink::udp && !missing) {
      const std::string line = fmt::format("{} {:.6f} {} {}\n", gauge.name.view(), number, it.seq, names);
      if (late) {
        it.late_line = line;
        it.late_port = gauge.port;
      } else {
        it.send(gauge.port, line);
      }
    } else if (gauge.link == GaugeLink::modbus && !missing && !late) {
      for (const auto& instrument : it.instruments)
        if (instrument->is_at(gauge)) instrument->show(gauge, number);
    }
  }
  return plc;
}

void GaugePeer::send_late() {
  if (!impl_->late_line.empty()) impl_->send(impl_->late_port, impl_->late_line);
}

double GaugePeer::true_value(std::string_view gauge) const {
  return impl_->truth[impl_->index_of(GaugeName(gauge))];
}

}  // namespace slabd::emulator
