// SPDX-License-Identifier: Apache-2.0
//
// Scans of real concrete (emulator/concrete_block.h, block_drawing.h) with known truth, measured as by the daemon. For
// each item: error, U and the number of scans in which U covers the error; verdicts of good blocks, and detected
// defects. The recipe is the shipped one with its whole budget. Two scans are drawn and measured at a time.
#include <fmt/core.h>

#include <atomic>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <map>
#include <thread>

#include "emulator/block_drawing.h"
#include "hal/hal.h"
#include "report/json.h"
#include "tests/accuracy/block_scan.h"
#include "tests/accuracy/studies.h"

namespace slabd::accuracy {
namespace {

using emulator::ConcreteDefect;
using emulator::ConcreteScan;
using emulator::Effect;
using emulator::EffectStrengths;

constexpr std::array kItems = {
    ItemId::seat_slope,   ItemId::seat_flatness,  ItemId::jaw_angle_inner,         ItemId::jaw_angle_outer,
    ItemId::jaw_distance, ItemId::casing_spacing, ItemId::casing_protrusion_inner, ItemId::casing_protrusion_outer};

/// One kind of block: its differences from the selected surface.
struct Kind {
  std::string name;
  EffectStrengths effects;
  std::vector<ConcreteDefect> defects;
};

/// One scan, drawn and measured.
struct Case {
  std::uint64_t seed = 0;
  ConcreteScan scan;
  BlockResult result;
  std::string trouble;
  double draw_s = 0.0;
  double measure_s = 0.0;
};

/// The items that did not pass, or the reason of the block if there are none.
std::vector<std::string> blamed(const Case& one) {
  std::vector<std::string> names;
  for (const Item& item : one.result.items)
    if (item.verdict != Verdict::pass && item.verdict != Verdict::none && item.required)
      names.emplace_back(info(item.id).name);
  if (names.empty() && one.result.verdict != Verdict::pass)
    names.push_back(one.trouble.empty() ? fmt::format("reason {}", one.result.reason) : one.trouble);
  return names;
}

void write_case(const RealOptions& options, const Case& one, const Kind& kind, const emulator::ConcreteView& view,
                const std::vector<float>& xyz) {
  std::filesystem::create_directories(options.out);
  const std::string path = fmt::format("{}/{}_{}", options.out, kind.name, one.seed);
  const emulator::DrawnScan& drawn = one.scan.drawn;
  if (const Status written =
          hal::write_ply((path + ".ply").c_str(), xyz, drawn.width, drawn.height, {.emulator = true});
      !written)
    fmt::print(stderr, "{}: {}\n", path, written.error().text.view());
  const emulator::ConcreteTruth& truth = one.scan.truth;
  report::Json json("slabd.concrete_truth/1");
  json.field("seed", one.seed).field("kind", kind.name);
  json.key("effects").begin_object();
  for (const emulator::EffectInfo& effect : emulator::effects())
    if (kind.effects[effect.effect] != 0.0) json.field(effect.name, kind.effects[effect.effect]);
  json.end_object().key("defects").begin_object();
  for (const ConcreteDefect& defect : kind.defects) json.field(info(defect.kind).name, defect.size);
  json.end_object().key("must_not_pass").begin_array();
  for (const ConcreteDefect& defect : kind.defects) json.value(info(defect.kind).item);
  json.end_array().key("items").begin_object();
  for (const ItemId id : kItems) json.field(info(id).name, truth.value(id));
  json.end_object();
  json.field("flatness_raw", truth.flatness_raw_mm).field("flatness_form", truth.flatness_form_mm);
  json.field("raw_low", truth.raw_low_mm).field("raw_high", truth.raw_high_mm);
  json.field("fillet_mm", truth.fillet_mm).field("chamfer_mm", truth.chamfer_mm);
  json.field("rim_covered", truth.rim_covered);
  json.field("T_block_scanner_reported", view.T_block_scanner_reported);
  json.field("T_scanner_block", view.T_scanner_block.matrix());
  json.field("outliers_planted", drawn.outliers).field("missing", drawn.missing).field("valid", drawn.valid);
  json.key("marks").begin_array();
  for (const emulator::PlantedMark& mark : truth.marks) {
    json.begin_object().field("kind", emulator::name(mark.kind)).field("x", mark.x_mm).field("y", mark.y_mm);
    json.field("z", mark.z_mm).field("length", mark.length_mm).field("width", mark.width_mm);
    json.field("depth", mark.depth_mm).field("in_crop", mark.in_crop).end_object();
  }
  json.end_array().end_object();
  std::ofstream(path + ".json") << json.text();
}

/// Draws and measures one scan.
class Bench {
 public:
  explicit Bench(const Recipe& recipe) : recipe_(recipe), xyz_(3 * limits::kScanPointsMax) { inspector_.use(recipe_); }

  Case measure(const RealOptions& options, const Kind& kind, std::uint64_t seed) {
    Case one;
    one.seed = seed;
    emulator::ConcreteOrder order;
    order.effects = kind.effects;
    order.defects = kind.defects;
    order.seed = seed;
    order.truth =
        emulator::scattered_truth(recipe_, emulator::nominal_truth(recipe_), kind.effects[Effect::cast], seed);
    const emulator::ConcreteView view = emulator::concrete_view(kind.effects, seed);
    emulator::ConcreteScanner scanner;
    scanner.seed = seed;
    scanner.step_mm = options.step_mm;
    if (options.full_grid) {
      scanner.columns = 2048;
      scanner.rows = 2448;
    }
    const auto started = std::chrono::steady_clock::now();
    one.scan = emulator::draw_concrete(recipe_, order, view.T_scanner_block, scanner,
                                       emulator::derived_seed(seed, 8, 0), xyz_);
    const auto drawn = std::chrono::steady_clock::now();
    if (!options.out.empty()) write_case(options, one, kind, view, xyz_);
    const auto begun = std::chrono::steady_clock::now();
    const std::size_t points = xyz_.size() / 3;
    inspector_.begin(1, Pose::identity(), view.T_block_scanner_reported);
    xyz_.resize(3 * limits::kScanPointsMax);
    algo::Cloud cloud{xyz_, points, one.scan.drawn.width, one.scan.drawn.height};
    Status status = inspector_.denoise(cloud);
    if (status) status = inspector_.register_to_model(cloud);
    if (status) status = inspector_.extract(cloud);
    inspector_.judge(status ? Code::ok : status.error().code);
    if (!status) one.trouble = status.error().text.c_str();
    one.result = inspector_.result();
    one.draw_s = std::chrono::duration<double>(drawn - started).count();
    one.measure_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - begun).count();
    return one;
  }

 private:
  Recipe recipe_;
  algo::BlockInspector inspector_;
  std::vector<float> xyz_;
};

std::vector<Case> measure_all(std::array<Bench, 2>& benches, const StudyOptions& options, const Kind& kind, int scans) {
  std::vector<Case> cases(static_cast<std::size_t>(scans));
  std::atomic<std::size_t> next{0};
  const auto work = [&](Bench& bench) {
    for (std::size_t i = next++; i < cases.size(); i = next++)
      cases[i] = bench.measure(options.real, kind, options.first + i);
  };
  {
    const std::jthread other([&] { work(benches[1]); });
    work(benches[0]);
  }
  return cases;
}

struct Figures {
  std::vector<double> error, U;
  int covered = 0;
  [[nodiscard]] double covered_percent() const {
    return error.empty() ? kNoValue : 100.0 * covered / static_cast<double>(error.size());
  }
  [[nodiscard]] double U_needed() const {
    std::vector<double> size;
    for (const double e : error) size.push_back(std::abs(e));
    return quantile(size, 0.95);
  }
};

/// Errors of one item against `truth_of(case)`.
template <typename Truth>
Figures figures_of(const std::vector<Case>& cases, ItemId id, const Truth& truth_of) {
  Figures figures;
  for (const Case& one : cases) {
    const Item* item = find_item(one.result.items.begin(), one.result.items.end(), id);
    if (item == nullptr || !has_value(item->value)) continue;
    const double error = item->value - truth_of(one);
    figures.error.push_back(error);
    figures.U.push_back(item->U);
    figures.covered += std::abs(error) <= item->U ? 1 : 0;
  }
  return figures;
}

Figures figures_of(const std::vector<Case>& cases, ItemId id) {
  return figures_of(cases, id, [&](const Case& one) { return one.scan.truth.value(id); });
}

struct Verdicts {
  int pass = 0, indeterminate = 0, fail = 0, not_measured = 0;
  std::map<std::string, int> blame;
};

Verdicts verdicts_of(const std::vector<Case>& cases) {
  Verdicts verdicts;
  for (const Case& one : cases) {
    switch (one.result.verdict) {
      case Verdict::pass: ++verdicts.pass; break;
      case Verdict::indeterminate: ++verdicts.indeterminate; break;
      case Verdict::fail: ++verdicts.fail; break;
      default: ++verdicts.not_measured; break;
    }
    for (const std::string& name : blamed(one)) ++verdicts.blame[name];
  }
  return verdicts;
}

std::string blame_text(const Verdicts& verdicts) {
  std::string text;
  for (const auto& [name, count] : verdicts.blame)
    text += fmt::format("{}{} {}", text.empty() ? "" : ", ", name, count);
  return text;
}

/// Counts of scans with a defect: passed blocks (missed), and scans in which the defect itself is reported (named). It
/// is if its item does not pass, or for damage, if a finding is within 25 mm of it.
struct Noticed {
  int missed = 0;
  int named = 0;
};

Noticed noticed(const std::vector<Case>& cases, const ConcreteDefect& defect) {
  Noticed n;
  const emulator::ConcreteDefectInfo& facts = info(defect.kind);
  for (const Case& one : cases) {
    n.missed += one.result.verdict == Verdict::pass ? 1 : 0;
    bool named = false;
    for (const Item& item : one.result.items)
      named = named || (info(item.id).name == facts.item && item.verdict != Verdict::pass);
    for (const emulator::PlantedMark& mark : one.scan.truth.marks) {
      if (mark.kind != emulator::MarkKind::damage && mark.kind != emulator::MarkKind::crack) continue;
      for (const SurfaceFinding& finding : one.result.findings) {
        const double dx = mark.kind == emulator::MarkKind::crack ? 0.0 : finding.x_mm - mark.x_mm;
        named = named || std::hypot(dx, finding.s_mm - mark.y_mm) < 25.0;
      }
    }
    n.named += named ? 1 : 0;
  }
  return n;
}

/// Items that pass although the truth is out of tolerance, which must never happen. `out` counts the items out of
/// tolerance. A crust is higher than the seat by its size, which the rim's true height does not include.
struct WrongPasses {
  int out = 0;
  int passed = 0;
  std::string which;
};

WrongPasses wrong_passes(const std::vector<Case>& cases, const Kind& kind, const Recipe& recipe) {
  WrongPasses wrong;
  const auto crust = std::find_if(kind.defects.begin(), kind.defects.end(), [](const ConcreteDefect& defect) {
    return defect.kind == emulator::ConcreteDefectKind::crust;
  });
  for (const Case& one : cases)
    for (const ItemId id : kItems) {
      const Tolerance& tolerance = recipe.tolerance(id);
      double truth = one.scan.truth.value(id);
      if (id == ItemId::casing_protrusion_outer && crust != kind.defects.end()) truth = std::max(truth, crust->size);
      // A missing limit of an item is NaN.
      if (!(truth < tolerance.lower) && !(truth > tolerance.upper)) continue;
      ++wrong.out;
      const Item* item = find_item(one.result.items.begin(), one.result.items.end(), id);
      if (item == nullptr || item->verdict != Verdict::pass) continue;
      ++wrong.passed;
      wrong.which += fmt::format(" {} of seed {} ({:.3f}, U {:.3f}, truth {:.3f})", info(id).name, one.seed,
                                 item->value, item->U, truth);
    }
  return wrong;
}

void print_item(std::string_view what, const Figures& f, std::string_view unit) {
  fmt::print("  {:24} {:4} {:>9.4f} {:>9.4f} {:>9.4f} {:>9.4f} {:>6.0f} %  {:>9.4f} {}\n", what, f.error.size(),
             mean(f.error), rms(f.error), largest([&] {
               std::vector<double> size;
               for (const double e : f.error) size.push_back(std::abs(e));
               return size;
             }()),
             mean(f.U), f.covered_percent(), f.U_needed(), unit);
}

void tell_item(const std::string& what, const Figures& f, const std::string& unit, Table& table) {
  table.tell(what + ", measured", static_cast<double>(f.error.size()), "");
  table.tell(what + ", bias", mean(f.error), unit);
  table.tell(what + ", rms error", rms(f.error), unit);
  table.tell(what + ", mean U", mean(f.U), unit);
  table.tell(what + ", U covers", f.covered_percent(), "%");
  table.tell(what + ", U needed for 95 %", f.U_needed(), unit);
}

/// Reports one kind: items, verdicts, seconds.
void report(const std::vector<Case>& cases, const Kind& kind, const Recipe& recipe, const StudyOptions& options,
            Table& table) {
  const WrongPasses wrong = wrong_passes(cases, kind, recipe);
  const Verdicts verdicts = verdicts_of(cases);
  std::vector<double> draw_s, measure_s;
  for (const Case& one : cases) {
    draw_s.push_back(one.draw_s);
    measure_s.push_back(one.measure_s);
  }
  const auto raw_of = [](const Case& one) { return one.scan.truth.flatness_raw_mm; };
  if (!options.as_json)
    fmt::print("  {:24} {:>4} {:>9} {:>9} {:>9} {:>9} {:>8}  {:>9}\n", kind.name, "n", "bias", "rms", "worst", "mean U",
               "covered", "U for 95");
  for (const ItemId id : kItems) {
    const std::string unit(slabd::name(info(id).unit));
    const std::string what(info(id).name);
    const auto show = [&](const std::string& text, const Figures& f) {
      if (options.as_json)
        tell_item(kind.name + ": " + text, f, unit, table);
      else
        print_item(text, f, unit);
    };
    show(id == ItemId::seat_flatness ? what + " (form)" : what, figures_of(cases, id));
    if (id == ItemId::seat_flatness) show(what + " (raw)", figures_of(cases, id, raw_of));
  }
  if (options.as_json) {
    table.tell(kind.name + ": pass", verdicts.pass, "");
    table.tell(kind.name + ": indeterminate", verdicts.indeterminate, "");
    table.tell(kind.name + ": fail", verdicts.fail, "");
    table.tell(kind.name + ": not measured", verdicts.not_measured, "");
    for (const auto& [name, count] : verdicts.blame) table.tell(kind.name + ": blamed " + name, count, "");
    table.tell(kind.name + ": items out of tolerance", wrong.out, "");
    table.tell(kind.name + ": of these passed", wrong.passed, "");
    return;
  }
  fmt::print("  verdicts: pass {}, indeterminate {}, fail {}, not measured {}; blamed: {}\n", verdicts.pass,
             verdicts.indeterminate, verdicts.fail, verdicts.not_measured, blame_text(verdicts));
  fmt::print("  out of tolerance: {} items, of these passed {}{}\n", wrong.out, wrong.passed, wrong.which);
  for (const ConcreteDefect& defect : kind.defects) {
    const Noticed n = noticed(cases, defect);
    fmt::print("  defect {} {}: passed {} of {}, pointed at in {}\n", info(defect.kind).name, defect.size, n.missed,
               cases.size(), n.named);
  }
  fmt::print("  drawn in {:.2f} s, measured in {:.2f} s a scan\n", mean(draw_s), mean(measure_s));
  if (options.real.each)
    for (const Case& one : cases) {
      fmt::print("  seed {:5} {:13}", one.seed, slabd::name(one.result.verdict));
      for (const ItemId id : kItems) {
        const Item* item = find_item(one.result.items.begin(), one.result.items.end(), id);
        if (item != nullptr) fmt::print(" {:+.4f}({:.3f})", item->value - one.scan.truth.value(id), item->U);
      }
      fmt::print(" form {:.3f} raw {:.3f} {}\n", one.scan.truth.flatness_form_mm, one.scan.truth.flatness_raw_mm,
                 one.trouble);
      for (const SurfaceFinding& f : one.result.findings)
        if (f.kind != FindingKind::pit || f.area_mm2 > 30.0)
          fmt::print("    {} on {} at ({:.1f}, {:.1f}): {:.1f} x {:.1f} mm, {:.2f} deep, {:.1f} mm2\n",
                     slabd::name(f.kind), slabd::name(f.face), f.x_mm, f.s_mm, f.length_mm, f.width_mm, f.depth_mm,
                     f.area_mm2);
    }
  std::fflush(stdout);
}

constexpr std::string_view kMarkdownHead =
    "| Scans | Pass | Indet. | Fail | None | Slope | Flatness | Jaw angles | Jaw distance | Spacing | Protrusions | "
    "Not "
    "passed because of |\n|---|---|---|---|---|---|---|---|---|---|---|---|\n";

/// A row of the table in docs/ACCURACY.md: verdicts, then for each kind of item the share that U covers and the mean
/// U. If there are two items of a kind, both are those of the worse one.
void print_markdown_row(const std::vector<Case>& cases, const Kind& kind) {
  const Verdicts v = verdicts_of(cases);
  fmt::print("| {} | {} | {} | {} | {} |", kind.name, v.pass, v.indeterminate, v.fail, v.not_measured);
  constexpr std::array<std::array<ItemId, 2>, 6> kColumns = {
      {{ItemId::seat_slope, ItemId::seat_slope},
       {ItemId::seat_flatness, ItemId::seat_flatness},
       {ItemId::jaw_angle_inner, ItemId::jaw_angle_outer},
       {ItemId::jaw_distance, ItemId::jaw_distance},
       {ItemId::casing_spacing, ItemId::casing_spacing},
       {ItemId::casing_protrusion_inner, ItemId::casing_protrusion_outer}}};
  for (const auto& [one, other] : kColumns) {
    std::size_t measured = 0;
    double covered = 100.0;
    double U = 0.0;
    for (const Figures& f : {figures_of(cases, one), figures_of(cases, other)}) {
      if (f.error.empty()) continue;
      measured = std::max(measured, f.error.size());
      covered = std::min(covered, f.covered_percent());
      U = std::max(U, mean(f.U));
    }
    fmt::print("{}", measured == 0 ? std::string(" - |") : fmt::format(" {:.0f} %, {:.2g} |", covered, U));
  }
  std::string why = blame_text(v);
  for (const ConcreteDefect& defect : kind.defects) {
    const Noticed n = noticed(cases, defect);
    why += fmt::format("{}{} of {} pointed at", why.empty() ? "" : "; ", n.named, cases.size());
  }
  fmt::print(" {} |\n", why);
  std::fflush(stdout);
}

/// Reports a kind as one line in the table of all effects and defects.
void report_line(const std::vector<Case>& cases, const Kind& kind, const Recipe& recipe, const StudyOptions& options,
                 Table& table) {
  const Verdicts v = verdicts_of(cases);
  if (options.as_json) {
    report(cases, kind, recipe, options, table);
    for (const ConcreteDefect& defect : kind.defects) {
      const Noticed n = noticed(cases, defect);
      table.tell(kind.name + ": passed", n.missed, "");
      table.tell(kind.name + ": pointed at", n.named, "");
    }
    return;
  }
  if (options.real.markdown) {
    print_markdown_row(cases, kind);
    return;
  }
  fmt::print("  {:16} {:2}/{:2}/{:2}/{:2}", kind.name, v.pass, v.indeterminate, v.fail, v.not_measured);
  for (const ItemId id : kItems) {
    const Figures f = figures_of(cases, id);
    if (f.error.empty())
      fmt::print(" {:>19}", "-");
    else
      fmt::print(" {:+.3f} {:.3f} {:3.0f}{}", mean(f.error), mean(f.U), f.covered_percent(),
                 f.error.size() == cases.size() ? "  " : fmt::format("!{}", cases.size() - f.error.size()));
  }
  for (const ConcreteDefect& defect : kind.defects) {
    const Noticed n = noticed(cases, defect);
    fmt::print(" [passed {}, pointed at {}]", n.missed, n.named);
  }
  fmt::print(" {}\n", blame_text(v));
  if (const WrongPasses wrong = wrong_passes(cases, kind, recipe); wrong.passed > 0)
    fmt::print("    PASSED OUT OF TOLERANCE:{}\n", wrong.which);
  std::fflush(stdout);
}

/// The surface of the paper's block: larger waves than in a good plant, and a scanner with little noise. The strengths
/// of wave and grain (seats) and of relief and cast (whole blocks) were adjusted by trial to the paper's figures.
constexpr std::array kPaperEffects = {"cast=1.5", "grain=1.6", "relief=2", "wave=3.1", "noise=0.5"};
/// Expected distance of a drawn lot of blocks from the paper's shares (one block of one mould), %.
constexpr std::array kPaperReach = {4.0, 2.0, 1.5};

std::optional<Kind> kind_of(const RealOptions& options) {
  Kind kind;
  const auto surface = emulator::surface_named(options.surface);
  if (!surface) {
    fmt::print(stderr, "slabd_accuracy: {}\n", surface.error().text.view());
    return std::nullopt;
  }
  kind.name = options.surface;
  kind.effects = EffectStrengths(surface.value());
  for (const std::string& text : options.effects) {
    if (const auto refused = kind.effects.take(text)) {
      fmt::print(stderr, "slabd_accuracy: {}\n", *refused);
      return std::nullopt;
    }
    kind.name += " " + text;
  }
  for (const std::string& text : options.defects) {
    const auto defect = emulator::parse_concrete_defect(text);
    if (!defect) {
      fmt::print(stderr, "slabd_accuracy: {}\n", defect.error().text.view());
      return std::nullopt;
    }
    kind.defects.push_back(defect.value());
    kind.name += " " + text;
  }
  std::replace(kind.name.begin(), kind.name.end(), ' ', '_');
  return kind;
}

}  // namespace

bool real_study(const StudyOptions& options, Table& table) {
  const std::optional<Recipe> recipe = reference_recipe();
  const std::optional<Kind> kind = kind_of(options.real);
  if (!recipe || !kind) return false;
  std::array<Bench, 2> benches = {Bench(*recipe), Bench(*recipe)};
  if (!options.real.table) {
    report(measure_all(benches, options, *kind, options.cases(20, 4)), *kind, *recipe, options, table);
    return true;
  }
  const int scans = options.cases(6, 2);
  if (options.real.markdown) {
    fmt::print("{}", kMarkdownHead);
  } else if (!options.as_json) {
    fmt::print("  {:16} {:11}", "pass/ind./fail", "/not meas.");
    for (const ItemId id : kItems) fmt::print(" {:19.19}", info(id).name);
    fmt::print("\n  {:28}", "");
    for (std::size_t i = 0; i < kItems.size(); ++i) fmt::print(" {:19}", "  bias   U  cov. %");
    fmt::print("\n");
  }
  report_line(measure_all(benches, options, *kind, scans), *kind, *recipe, options, table);
  for (const emulator::EffectInfo& effect : emulator::effects()) {
    Kind raised = *kind;
    const double strength = effect.usual == 0.0 ? 1.0 : 2.0 * effect.usual;
    raised.effects.set(effect.effect, strength);
    raised.name = fmt::format("{} {}", effect.name, strength);
    report_line(measure_all(benches, options, raised, scans), raised, *recipe, options, table);
  }
  for (const emulator::ConcreteDefectInfo& defect : emulator::concrete_defects()) {
    Kind damaged = *kind;
    damaged.defects = {{defect.kind, defect.usual}};
    damaged.name = fmt::format("{} {}", defect.name, defect.usual);
    report_line(measure_all(benches, options, damaged, scans), damaged, *recipe, options, table);
  }
  return true;
}

/// Eighteen seats of the paper's slab. Table 5 and Fig. 17 have a standard deviation of 0.013 to 0.029 mm and a
/// (trimmed) flatness of 0.057 to 0.103 mm. Table 4 has 79, 96 and 98 % of all points within 1, 2 and 3 standard
/// deviations of the model. The concrete deviates from its model as cast blocks do; the scanner is good.
bool paper_study(const StudyOptions& options, Table& table) {
  const std::optional<Recipe> recipe = reference_recipe();
  if (!recipe) return false;
  StudyOptions of_paper = options;
  of_paper.real.surface = "clean";
  // The effects of the command line come last, because they override the others.
  of_paper.real.effects.insert(of_paper.real.effects.begin(), kPaperEffects.begin(), kPaperEffects.end());
  const std::optional<Kind> kind = kind_of(of_paper.real);
  if (!kind) return false;
  std::array<Bench, 2> benches = {Bench(*recipe), Bench(*recipe)};
  std::vector<double> std_mm, trimmed_mm;
  std::array<std::vector<double>, 3> within;
  for (const Case& one : measure_all(benches, of_paper, *kind, of_paper.cases(18, 4))) {
    std_mm.push_back(one.result.seat.plane.std_mm);
    trimmed_mm.push_back(one.result.seat.flatness_trimmed_mm);
    for (std::size_t k = 0; k < within.size(); ++k)
      within[k].push_back(100.0 * one.result.registration.deviation.within_sigma[k]);
  }
  table.within("seat standard deviation, least", quantile(std_mm, 0.0), 0.013, 0.029, "mm");
  table.within("seat standard deviation, largest", largest(std_mm), 0.013, 0.029, "mm");
  table.within("trimmed flatness, least", quantile(trimmed_mm, 0.0), 0.057, 0.103, "mm");
  table.within("trimmed flatness, largest", largest(trimmed_mm), 0.057, 0.103, "mm");
  constexpr std::array kPaperWithin = {78.9, 96.3, 98.0};
  for (std::size_t k = 0; k < within.size(); ++k)
    table.within(fmt::format("points within {} standard deviations of the model, mean", k + 1), mean(within[k]),
                 kPaperWithin[k] - kPaperReach[k], kPaperWithin[k] + kPaperReach[k], "%");
  return true;
}

}  // namespace slabd::accuracy
