// SPDX-License-Identifier: Apache-2.0
//
// Reports of a stored slab: the figures are equal to those in database, JSON and PLC record, in every format and
// language.
#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>
#include <regex>

#include "base/prng.h"
#include "hal/plc/plc_map.h"
#include "report/canvas.h"
#include "report/figures.h"
#include "report/words.h"
#include "storage/storage.h"
#include "tests/cli/slabctl_process.h"

namespace slabd::cli {
namespace {

using nlohmann::json;

/// The cells of a row of an HTML table, without tags.
using Row = std::vector<std::string>;

class ReportTest : public Slabctl {
 protected:
  ReportTest() {
    auto opened = storage::open_store({file("slabd.db"), file("spool"), 0});
    EXPECT_TRUE(opened.ok());
    store_ = std::move(opened.value());
    header_.key = 1;
    header_.slab_id = "A&B <7>";
    header_.stations = 18;
    header_.cell_mm = 1.5;
    header_.recipe = "P5600";
    header_.recipe_sha256 = "0123abcd";
    header_.software = "slabd 9.9.9";
    header_.calibration_id = "he-123";
    header_.guard = 1.0;
    header_.unconfirmed = 12;
    header_.began_utime_us = 1'763'681'281'000'000;
    apply(BeginSlabJob{header_, 1, 1});
  }
  void apply(const decltype(StoreJob::what)& what) {
    const Status status = store_->apply({1, what});
    ASSERT_TRUE(status.ok()) << status.error().text.view();
  }
  /// Difficult values: ties of the last digit, negative zero, carries.
  static Item an_item(Prng& prng, ItemId id, int station) {
    Item item;
    item.id = id;
    item.station = static_cast<std::uint8_t>(station);
    item.nominal = info(id).unit == ItemUnit::deg ? 1.432096 : 380.0;
    const double places = std::pow(10.0, report::decimals(id));
    item.value = item.nominal + (std::round(prng.normal() * places) + (station == 2 ? 0.5 : 0.3)) / places;
    if (station == 7) item.value = item.nominal - 1e-9;
    item.lower = item.nominal - 0.5;
    item.upper = item.nominal + 0.5;
    item.U = 0.05;
    item.verdict = judge(item, 1.0);
    return item;
  }
  void measure(int station, bool with_maps = true) {
    Prng prng(static_cast<std::uint64_t>(station));
    Attempt attempt;
    attempt.slab_key = 1;
    attempt.station = static_cast<std::uint8_t>(station);
    attempt.number = 1;
    attempt.emulated = emulated_;
    apply(AcquiredJob{attempt});
    BlockResult block;
    block.station = attempt.station;
    for (const ItemId id : {ItemId::seat_slope, ItemId::seat_flatness, ItemId::jaw_angle_inner, ItemId::jaw_distance})
      EXPECT_TRUE(block.items.push(an_item(prng, id, station)));
    for (const SurfaceFinding& finding : findings_) EXPECT_TRUE(block.findings.push(finding));
    if (has_value(pores_.largest_mm)) {
      Item pores{ItemId::surface_pores, Verdict::none, true, attempt.station, 0, pores_.largest_mm, 0.0};
      pores.upper = 10.0;
      pores.U = 1.0;
      pores.verdict = with_pore_limits(judge(pores, 1.0), pores_);
      EXPECT_TRUE(block.items.push(pores));
      block.pores = pores_;
    }
    for (const EdgeFeature& edge : edges_) EXPECT_TRUE(block.edges.push(edge));
    block.verdict = with_findings(combine(block.items.begin(), block.items.end()), block);
    block.seat.plane.ok = block.seat.full_plane.ok = true;
    block.jaw_inner.doubt = jaw_doubt_;
    block.casing_outer.doubt = casing_doubt_;
    block.seat.plane.std_mm = 0.0301;
    block.seat.flatness_mm = 0.1234;
    block.seat.normal_datum = Vec3(0.0001, -0.025, 0.9997);
    block.registration.status = RegistrationStatus::converged;
    block.registration.deviation = {1000, 0.001, 0.03, {0.6827, 0.9545, 0.9973, 0.9999, 1.0, 1.0}};
    BlockMaps maps;
    if (with_maps) {
      pack_map(
          100, 150, 4.0, 0.01, [&](std::size_t, std::size_t) { return 0.03 * prng.normal(); }, maps.registration);
      pack_map(
          68, 100, 1.5, 0.005, [&](std::size_t, std::size_t) { return 0.005 * prng.normal(); }, maps.seat);
    }
    PlcResult record = station_record(block);
    record.res_seq = static_cast<std::uint16_t>(station);
    record.station = attempt.station;
    records_.push_back(record);
    blocks_.push_back(block);
    apply(BlockJob{1, 1, block, record, maps});
  }
  void end() {
    Prng prng(99);
    SlabResult slab;
    slab.verdict = Verdict::fail;
    for (std::size_t i = 0; i < blocks_.size(); ++i) slab.station_verdict[i] = blocks_[i].verdict;
    for (int station = 1; station <= 18; ++station)
      EXPECT_TRUE(slab.items.push(an_item(prng, ItemId::seat_lateral, station)));
    PlcResult record;
    record.kind = 2;
    record.res_seq = 100;
    apply(SlabJob{1, slab, record, 1'763'681'999'000'000});
  }
  void make_slab() {
    for (int station = 1; station <= 18; ++station) measure(station, station != 5);
    end();
  }
  [[nodiscard]] Ended report(const std::string& out, const std::string& more = "") const {
    return run("report 1 --db " + file("slabd.db") + " --out " + file(out) + " " + more);
  }
  /// All rows of all tables of the document below the heading that begins with `heading`.
  static std::vector<Row> rows_below(const std::string& html, const std::string& heading) {
    std::vector<Row> rows;
    const std::regex title(">[^<>]*" + heading + "[^0-9]");
    std::smatch found;
    std::size_t begin = std::string::npos;
    for (std::size_t at = html.find("<h2>"); at != std::string::npos; at = html.find("<h2>", at + 1)) {
      const std::string line = html.substr(at, html.find("</h2>", at) - at) + " ";
      if (std::regex_search(line, found, title)) begin = at;
    }
    if (begin == std::string::npos) return rows;
    const std::string section = html.substr(begin, html.find("</section>", begin) - begin);
    for (std::size_t at = section.find("<tr"); at != std::string::npos; at = section.find("<tr", at + 1)) {
      std::string line = section.substr(at, section.find("</tr>", at) - at);
      Row& row = rows.emplace_back();
      const std::regex cell("<t[dh][^>]*>([^<]*)</t[dh]>");
      for (std::sregex_iterator it(line.begin(), line.end(), cell), stop; it != stop; ++it) row.push_back((*it)[1]);
    }
    return rows;
  }
  static const Row* row_of(const std::vector<Row>& rows, const std::string& first) {
    for (const Row& row : rows)
      if (!row.empty() && row[0] == first) return &row;
    return nullptr;
  }

  std::unique_ptr<storage::Store> store_;
  SlabHeader header_;
  std::uint8_t emulated_ = 0;  ///< emulation bits of every attempt
  std::vector<BlockResult> blocks_;
  std::vector<PlcResult> records_;
  std::vector<SurfaceFinding> findings_;  ///< findings of the next blocks
  PoreSummary pores_;
  std::vector<EdgeFeature> edges_;
  PlaneDoubt jaw_doubt_ = PlaneDoubt::not_fitted;
  CasingDoubt casing_doubt_ = CasingDoubt::not_measured;
};

TEST_F(ReportTest, reason_for_an_unmeasured_feature_is_given_in_report_show_and_json) {
  jaw_doubt_ = PlaneDoubt::second_surface;
  casing_doubt_ = CasingDoubt::no_hole;
  measure(1);
  jaw_doubt_ = PlaneDoubt::not_fitted;
  casing_doubt_ = CasingDoubt::not_measured;
  for (int station = 2; station <= 18; ++station) measure(station);
  end();
  const std::string told =
      "inner jaw: a second surface is within the threshold; outer casing: something fills the bore at the height of "
      "the rim";
  ASSERT_EQ(report("r.html", "--full").status, 0);
  EXPECT_NE(content(file("r.html")).find("Not measured: " + told), std::string::npos);
  ASSERT_EQ(report("zh.html", "--full --language zh").status, 0);
  EXPECT_NE(content(file("zh.html")).find("未测量：内侧钳口面：阈值内另有一个表面；外侧套管：孔口高度处有填塞物"),
            std::string::npos);
  EXPECT_NE(run("show 1 --db " + file("slabd.db") + " --block 1").out.find("not measured: " + told), std::string::npos);
  EXPECT_EQ(run("show 1 --db " + file("slabd.db") + " --block 2").out.find("not measured: "), std::string::npos);
  const json document = json::parse(run("show 1 --db " + file("slabd.db") + " --json").out);
  EXPECT_EQ(document["blocks"][0]["result"]["features"]["jaw_inner"]["doubt"], "second_surface");
  EXPECT_EQ(document["blocks"][0]["result"]["features"]["casing_outer"]["doubt"], "no_hole");
}

TEST_F(ReportTest, findings_of_a_block_are_listed_with_place_and_size_in_report_show_and_json) {
  SurfaceFinding finding;
  finding.kind = FindingKind::chip;
  finding.face = FindingFace::jaw_outer;
  finding.x_mm = 81.0;
  finding.s_mm = 190.0;
  finding.z_mm = 12.0;
  finding.length_mm = 40.0;
  finding.width_mm = 15.0;
  finding.area_mm2 = 600.0;
  finding.depth_mm = 15.0;
  findings_ = {finding};
  measure(1);
  findings_.clear();
  for (int station = 2; station <= 18; ++station) measure(station);
  end();
  const std::string told = "chip on the outer jaw at x 81 mm, s 190 mm: 40 x 15 mm, 600 mm2, up to 15.0 mm deep";
  ASSERT_EQ(report("r.html").status, 0);
  EXPECT_NE(content(file("r.html")).find("Block 1: " + told), std::string::npos);
  ASSERT_EQ(report("zh.html", "--language zh").status, 0) << report("zh.html", "--language zh").err;
  EXPECT_NE(content(file("zh.html")).find("外侧钳口面掉角，位置 x 81 mm，s 190 mm"), std::string::npos);
  EXPECT_NE(run("show 1 --db " + file("slabd.db") + " --block 1").out.find("finding: " + told), std::string::npos);
  EXPECT_EQ(run("show 1 --db " + file("slabd.db") + " --block 2").out.find("finding:"), std::string::npos);
  const json document = json::parse(run("show 1 --db " + file("slabd.db") + " --json").out);
  const json& first = document["blocks"][0]["result"]["findings"];
  ASSERT_EQ(first.size(), 1U);
  EXPECT_EQ(first[0]["kind"], "chip");
  EXPECT_EQ(first[0]["face"], "jaw_outer");
  EXPECT_EQ(first[0]["depth_mm"], 15.0);
  EXPECT_TRUE(first[0]["volume_mm3"].is_null());
  EXPECT_TRUE(document["blocks"][1]["result"]["findings"].empty());
}

TEST_F(ReportTest, damage_is_marked_on_the_maps_and_small_pores_are_not) {
  SurfaceFinding pore;
  pore.x_mm = 33.0;
  pore.s_mm = 44.0;
  pore.length_mm = pore.width_mm = 4.0;
  pore.area_mm2 = 12.0;
  pore.depth_mm = 2.0;
  SurfaceFinding deep = pore;
  deep.x_mm = -20.0;
  deep.depth_mm = 6.5;
  findings_ = {deep, pore};
  pores_ = {2, 3.9, 6.5, 0.0003, {5.0, 0.02}};
  measure(1);
  findings_ = {pore};
  pores_ = {1, 3.9, 2.0, 0.0001, {5.0, 0.02}};
  edges_ = {{EdgeFace::seat, EdgeFace::jaw_inner, 4.12, kNoValue, 4.0, 140},
            {EdgeFace::seat, EdgeFace::end_minus, kNoValue, 3.6, kNoValue, 286},
            {EdgeFace::seat, EdgeFace::end_plus, kNoValue, 4.24, kNoValue, 280}};
  for (int station = 2; station <= 18; ++station) measure(station);
  end();
  ASSERT_EQ(report("r.html", "--full").status, 0);
  const std::string html = content(file("r.html"));
  const std::string told = "pit on the seat at x -20 mm, s 44 mm: 4 x 4 mm, 12 mm2, up to 6.5 mm deep";
  EXPECT_NE(html.find("Block 1: " + told), std::string::npos);
  const std::string alt = html.substr(html.find("Block 1, Deviation"), 300);
  EXPECT_NE(alt.find(told), std::string::npos) << alt;
  EXPECT_EQ(html.find("at x 33 mm"), std::string::npos) << "a small pore is one of many";
  EXPECT_NE(html.find("(2 pores, largest 3.9 mm, deepest 6.5 mm (more than 5 mm), 0.03 % of the area (at most 2 "
                      "%))"),
            std::string::npos);
  EXPECT_NE(html.find("Pores: 1 pore, largest 3.9 mm, deepest 2.0 mm (at most 5 mm)"), std::string::npos);
  EXPECT_NE(html.find("Edges: fillet 4.1 mm seat/jaw_inner (nominal 4), chamfer 3.6..4.2 mm ends"), std::string::npos);
  ASSERT_EQ(report("r.pdf").status, 0);
  ASSERT_EQ(report("zh.html", "--full --language zh").status, 0);
  EXPECT_NE(content(file("zh.html")).find("最深 6.5 mm（超过 5 mm）"), std::string::npos);
  EXPECT_NE(content(file("zh.html")).find("圆角 4.1 mm 承轨面/内侧钳口面（公称 4），倒角 3.6..4.2 mm 端面"),
            std::string::npos);
  const std::string slab = run("show 1 --db " + file("slabd.db")).out;
  EXPECT_NE(slab.find("!1"), std::string::npos) << slab;
  EXPECT_NE(slab.find("!N  N findings other than small pores"), std::string::npos) << slab;
  const std::string block = run("show 1 --db " + file("slabd.db") + " --block 2").out;
  EXPECT_NE(block.find("edges: fillet 4.1 mm seat/jaw_inner (nominal 4), chamfer 3.6..4.2 mm ends\n"),
            std::string::npos)
      << block;
  const json document = json::parse(run("show 1 --db " + file("slabd.db") + " --json").out);
  const json& edges = document["blocks"][1]["result"]["features"]["edges"];
  ASSERT_EQ(edges.size(), 3U);
  EXPECT_EQ(edges[0]["between"], (json{"seat", "jaw_inner"}));
  EXPECT_EQ(edges[0]["radius_mm"], 4.12);
  EXPECT_TRUE(edges[0]["chamfer_mm"].is_null());
  EXPECT_EQ(edges[0]["n"], 140);
  EXPECT_TRUE(document["blocks"][0]["result"]["features"]["edges"].empty());
  EXPECT_EQ(document["blocks"][0]["result"]["pores"]["depth_max_mm"], 5.0);
}

TEST_F(ReportTest, figures_agree_with_database_json_and_plc_record_to_the_last_digit_shown) {
  make_slab();
  ASSERT_EQ(report("r.html", "--full").status, 0) << report("r.html", "--full").err;
  const std::string html = content(file("r.html"));
  const json document = json::parse(run("show 1 --db " + file("slabd.db") + " --json").out);
  int compared = 0;
  for (const json& attempt : document["blocks"]) {
    const int station = attempt["station"];
    const std::vector<Row> rows = rows_below(html, "Block " + std::to_string(station));
    const std::string text = run("show 1 --db " + file("slabd.db") + " --block " + std::to_string(station)).out;
    PlcOutputs outputs;
    outputs.result = true;
    outputs.record = records_[static_cast<std::size_t>(station - 1)];
    hal::InputImage image{};
    hal::encode_outputs(outputs, hal::WordOrder::abcd, image);
    for (const json& item : attempt["result"]["items"]) {
      const ItemId id = *item_from_name(item["id"].get<std::string>());
      const Row* row = row_of(rows, report::item_word(id, report::Language::en));
      ASSERT_NE(row, nullptr) << station << " " << item["id"];
      ASSERT_EQ(row->size(), 8U);
      const int digits = report::decimals(id);
      EXPECT_EQ((*row)[2], report::figure(item["nominal"], digits));
      EXPECT_EQ((*row)[4], report::figure(item["value"], digits));
      EXPECT_EQ((*row)[5], report::figure(item["deviation"], digits));
      EXPECT_EQ((*row)[6], report::figure(item["U"], digits));
      EXPECT_NE(text.find((*row)[4]), std::string::npos) << "the terminal shows another value";
      EXPECT_NE(text.find((*row)[5]), std::string::npos) << "the terminal shows another deviation";
      EXPECT_NE((*row)[5], "-0.000");
      EXPECT_NE((*row)[5], "-0.0000");
      // Position in the record (IR 42 on). All values of station 2 are ties, which may be rounded either way.
      const int place = id == ItemId::seat_slope        ? 0
                        : id == ItemId::jaw_angle_inner ? 1
                        : id == ItemId::jaw_distance    ? 3
                                                        : -1;
      if (place >= 0 && station != 2) {
        const auto thousandths = static_cast<std::int16_t>(image[42 + static_cast<std::size_t>(place)]);
        // Degrees are shown with one digit more than the register has.
        EXPECT_LE(std::abs(std::stod((*row)[5]) * 1000.0 - thousandths), digits == 3 ? 0.001 : 0.551)
            << station << " " << item["id"];
        ++compared;
      }
    }
  }
  EXPECT_EQ(compared, 17 * 3);
}

// The slope computed by SLAB_END is the valid one and must be shown in all outputs: the block's page, the slab's
// table, the JSON document and the slab's record for the PLC.
TEST_F(ReportTest, the_slabs_own_items_agree_in_report_json_and_the_slabs_record) {
  for (int station = 1; station <= 18; ++station) measure(station);
  Prng prng(7);
  SlabResult slab;
  slab.verdict = Verdict::fail;
  for (std::size_t i = 0; i < blocks_.size(); ++i) slab.station_verdict[i] = blocks_[i].verdict;
  for (int station = 1; station <= 18; ++station)
    for (const ItemId id : {ItemId::seat_slope, ItemId::seat_lateral, ItemId::seat_vertical})
      ASSERT_TRUE(slab.items.push(an_item(prng, id, station)));
  PlcResult record = slab_record(slab, 18);
  record.res_seq = 100;
  apply(SlabJob{1, slab, record, 1'763'681'999'000'000});
  ASSERT_EQ(report("r.html", "--full").status, 0);
  const std::string html = content(file("r.html"));
  const json document = json::parse(run("show 1 --db " + file("slabd.db") + " --json").out);
  const std::vector<Row> of_slab = rows_below(html, "Items of the slab");
  int compared = 0;
  std::array<std::pair<double, double>, 3> worst{};  // deviation by size, as shown
  for (const json& item : document["items"]) {
    const ItemId id = *item_from_name(item["id"].get<std::string>());
    const int station = item["stations"][0];
    const std::string word = report::item_word(id, report::Language::en);
    const std::vector<Row> of_block = rows_below(html, "Block " + std::to_string(station));
    ASSERT_EQ(
        std::count_if(of_block.begin(), of_block.end(), [&](const Row& row) { return !row.empty() && row[0] == word; }),
        1)
        << word << " of block " << station << ": the provisional one beside the final one";
    const Row* const on_page = row_of(of_block, word);
    const Row* const in_table = row_of(of_slab, word + " " + std::to_string(station));
    ASSERT_NE(on_page, nullptr);
    ASSERT_NE(in_table, nullptr) << word << " " << station;
    const int digits = report::decimals(id);
    for (const Row* row : {on_page, in_table}) {
      EXPECT_EQ((*row)[4], report::figure(item["value"], digits));
      EXPECT_EQ((*row)[5], report::figure(item["deviation"], digits));
      EXPECT_EQ((*row)[6], report::figure(item["U"], digits));
    }
    auto& furthest = worst.at(id == ItemId::seat_slope ? 0 : id == ItemId::seat_lateral ? 1 : 2);
    const double deviation = std::stod((*on_page)[5]);
    if (std::abs(deviation) > std::abs(furthest.first)) furthest = {deviation, station};
    ++compared;
  }
  EXPECT_EQ(compared, 54);
  PlcOutputs outputs;
  outputs.result = true;
  outputs.record = record;
  hal::InputImage image{};
  hal::encode_outputs(outputs, hal::WordOrder::abcd, image);
  // IR 49, 51, 53: the worst of each kind, each followed by its station.
  for (std::size_t k = 0; k < worst.size(); ++k) {
    EXPECT_LE(std::abs(worst.at(k).first * 1000.0 - static_cast<std::int16_t>(image[49 + 2 * k])), 0.551) << k;
    EXPECT_EQ(image[50 + 2 * k], worst.at(k).second) << k;
  }
}

// WCAG 2 requires 4.5 : 1 between small text and its background.
TEST(ReportColours, ink_of_every_verdict_can_be_read_on_its_fill) {
  const auto luminance = [](const report::Colour& colour) {
    const auto linear = [](double c) { return c <= 0.04045 ? c / 12.92 : std::pow((c + 0.055) / 1.055, 2.4); };
    return 0.2126 * linear(colour.r) + 0.7152 * linear(colour.g) + 0.0722 * linear(colour.b);
  };
  for (const Verdict verdict :
       {Verdict::none, Verdict::pass, Verdict::fail, Verdict::not_measured, Verdict::aborted, Verdict::indeterminate}) {
    const report::VerdictLook look = report::look_of(verdict);
    const double a = luminance(look.fill) + 0.05;
    const double b = luminance(look.ink) + 0.05;
    EXPECT_GE(std::max(a, b) / std::min(a, b), 4.5) << name(verdict);
  }
}

TEST_F(ReportTest, html_is_one_document_with_scopes_captions_descriptions_and_a_language) {
  make_slab();
  for (const std::string language : {"en", "zh"}) {
    ASSERT_EQ(report("r.html", "--language " + language).status, 0);
    const std::string html = content(file("r.html"));
    expect_mentions(html, "<html lang=\"" + language + "\">");
    EXPECT_EQ(html.find("<script"), std::string::npos);
    EXPECT_EQ(html.find("http://"), html.find("http://www.w3.org")) << "only namespaces may name an address";
    EXPECT_EQ(html.find("A&B <7>"), std::string::npos) << "text must be escaped";
    expect_mentions(html, "A&amp;B &lt;7&gt;");
    const auto count = [&](const std::string& what) {
      std::size_t found = 0;
      for (std::size_t at = html.find(what); at != std::string::npos; at = html.find(what, at + 1)) ++found;
      return found;
    };
    EXPECT_EQ(count("<table>"), count("<caption>"));
    EXPECT_EQ(count("<th "), count("<th scope="));
    EXPECT_EQ(count("<figure>"), count("role=\"img\" aria-label="));
    EXPECT_EQ(count("<h1>"), 1U);
    // Ids must be unique.
    std::vector<std::string> ids;
    const std::regex id(" id=\"([^\"]*)\"");
    for (std::sregex_iterator it(html.begin(), html.end(), id), stop; it != stop; ++it) ids.push_back((*it)[1]);
    const std::size_t all = ids.size();
    std::sort(ids.begin(), ids.end());
    ids.erase(std::unique(ids.begin(), ids.end()), ids.end());
    EXPECT_EQ(ids.size(), all);
  }
}

TEST_F(ReportTest, has_a_watermark_and_a_notice_in_both_languages_for_an_emulated_slab) {
  emulated_ = kEmulatedRobot;
  make_slab();
  ASSERT_EQ(report("r.html").status, 0);
  expect_mentions(content(file("r.html")), "class=\"watermark\" aria-hidden=\"true\">EMULATED<");
  expect_mentions(content(file("r.html")), "EMULATED (robot emulated): no verdict on concrete");
  expect_mentions(content(file("r.html")), " (EMULATED)</p>");
  ASSERT_EQ(report("r.html", "--language zh").status, 0);
  expect_mentions(content(file("r.html")), "仿真（机器人为仿真）：不是对混凝土实物的结论");
}

TEST_F(ReportTest, has_no_watermark_for_a_real_slab) {
  make_slab();
  ASSERT_EQ(report("r.html").status, 0);
  EXPECT_EQ(content(file("r.html")).find("class=\"watermark\""), std::string::npos);
  EXPECT_EQ(content(file("r.html")).find("EMULATED"), std::string::npos);
}

TEST_F(ReportTest, says_what_was_not_confirmed_not_visible_and_not_kept) {
  make_slab();
  ASSERT_EQ(report("r.html", "--full").status, 0);
  const std::string html = content(file("r.html"));
  expect_mentions(html, "12 nominals, tolerances and assumptions of the recipe had not been confirmed");
  expect_mentions(html, "Not visible to the scans of the blocks, and not judged: length, width, thickness and bottom");
  expect_mentions(html, "No map was kept with this block");  // block 5
  expect_mentions(html, "he-123");
  expect_mentions(html, "slabd 9.9.9");
  expect_mentions(html, "P5600, 0123abcd");
}

TEST_F(ReportTest, has_the_answer_on_two_pages_and_only_the_blocks_with_findings) {
  make_slab();
  ASSERT_EQ(report("r.html", "--project 'Line 7 <A>'").status, 0);
  const std::string html = content(file("r.html"));
  for (const char* text : {"Line 7 &lt;A&gt;", "Disposition and signatures", "+00:00", "2025-11-20 23:28:01"})
    expect_mentions(html, text);
  EXPECT_FALSE(rows_below(html, "Block 1").empty()) << "jaw distance fails";
  EXPECT_TRUE(rows_below(html, "Block 7").empty()) << "all its values are nominal";
  EXPECT_TRUE(rows_below(html, "Items of the slab").empty());
  ASSERT_EQ(report("full.html", "--full").status, 0);
  EXPECT_FALSE(rows_below(content(file("full.html")), "Block 7").empty());
  EXPECT_FALSE(rows_below(content(file("full.html")), "Items of the slab").empty());
  const std::size_t after_map = html.find("<h2>Findings");
  EXPECT_LT(after_map, html.find("<h2>Measured slab"));
  EXPECT_LT(html.find("Disposition and signatures"), html.find("<h2>✗ Block"));
}

TEST_F(ReportTest, a_finding_of_the_slab_beyond_the_first_page_is_in_the_table_of_its_items) {
  SurfaceFinding finding;
  finding.kind = FindingKind::chip;
  finding.face = FindingFace::jaw_outer;
  finding.length_mm = 40.0;
  finding.area_mm2 = 600.0;
  finding.depth_mm = 15.0;
  findings_ = {finding, finding};
  for (int station = 1; station <= 18; ++station) measure(station);
  SlabResult slab;
  slab.verdict = Verdict::fail;
  slab.fit.ok = true;
  slab.fit.note = "slab top unseen, roll unconfirmed";
  Item level{ItemId::corner_level, Verdict::fail, true, 0, 0, 2.5, 0.0};
  level.upper = 1.0;
  level.U = 0.1;
  EXPECT_TRUE(slab.items.push(level));
  PlcResult record;
  record.kind = 2;
  record.res_seq = 100;
  apply(SlabJob{1, slab, record, 1'763'681'999'000'000});
  ASSERT_EQ(report("r.html").status, 0);
  const std::string html = content(file("r.html"));
  EXPECT_EQ(html.find("2.500 mm, limits"), std::string::npos) << "the first page has no room for it";
  const std::vector<Row> rows = rows_below(html, "Items of the slab");
  EXPECT_TRUE(std::any_of(rows.begin(), rows.end(),
                          [](const Row& row) { return std::find(row.begin(), row.end(), "2.500") != row.end(); }));
  ASSERT_EQ(report("zh.html", "--language zh").status, 0);
  expect_mentions(content(file("zh.html")), "未看到板顶面，侧倾未经确认");
}

TEST_F(ReportTest, counts_items_that_were_not_required_and_not_measured_for_a_slab_that_passed) {
  for (const bool required : {true, false}) {
    PlcResult record;
    record.res_seq = static_cast<std::uint16_t>(20 * header_.key);
    for (std::uint8_t station = 1; station <= 18; ++station) {
      Attempt attempt;
      attempt.slab_key = header_.key;
      attempt.station = station;
      attempt.number = 1;
      apply(AcquiredJob{attempt});
      BlockResult block;
      block.station = station;
      block.verdict = Verdict::pass;
      for (const ItemId id : {ItemId::jaw_distance, ItemId::casing_skew_inner}) {
        Item item;
        item.id = id;
        item.required = required || id == ItemId::jaw_distance;
        item.verdict = item.required ? Verdict::pass : Verdict::not_measured;
        EXPECT_TRUE(block.items.push(item));
      }
      record.kind = 1;
      ++record.res_seq;
      record.station = station;
      apply(BlockJob{header_.key, 1, block, record});
    }
    SlabResult slab;
    slab.verdict = Verdict::pass;
    slab.station_verdict.fill(Verdict::pass);
    record.kind = 2;
    ++record.res_seq;
    apply(SlabJob{header_.key, slab, record, 1'763'681'999'000'000});
    for (const std::string language : {"en", "zh"}) {
      const std::string name = std::to_string(header_.key) + language + ".html";
      ASSERT_EQ(run("report key:" + std::to_string(header_.key) + " --db " + file("slabd.db") + " --language " +
                    language + " --out " + file(name))
                    .status,
                0);
      const std::string html = content(file(name));
      if (required)
        expect_mentions(html, language == "en" ? "Every item was measured and is within its limits."
                                               : "全部项目均已测量并在限值内。");
      else
        expect_mentions(html,
                        language == "en" ? "Not required and not measured: 18." : "配方不要求且未测量的项目：18 个。");
    }
    if (!required) break;
    header_.key = 2;
    header_.slab_id = "SECOND";
    apply(BeginSlabJob{header_, 1, 2});
  }
}

TEST_F(ReportTest, passes_no_block_of_an_aborted_slab_and_names_items_that_were_never_judged) {
  measure(7);  // all its values are nominal
  ASSERT_EQ(blocks_.back().verdict, Verdict::pass);
  Attempt attempt;
  attempt.slab_key = 1;
  attempt.station = 10;
  attempt.number = 1;
  apply(AcquiredJob{attempt});
  SlabResult slab;
  slab.verdict = Verdict::aborted;
  slab.reason = 110;
  PlcResult record;
  record.kind = 2;
  record.res_seq = 100;
  apply(SlabJob{1, slab, record, 1'763'681'999'000'000});
  ASSERT_EQ(report("r.html", "--full").status, 0);
  const std::string html = content(file("r.html"));
  expect_mentions(html, "<h2>Block 7 – no verdict: the slab was aborted</h2>");
  expect_mentions(html, "were never judged, and a block that passed so far has no verdict.");
  expect_mentions(html, "Block 10: Scanned, not measured: the slab was aborted.");
  EXPECT_EQ(html.find("could not be measured: <"), std::string::npos) << "with nothing behind it";
  EXPECT_EQ(html.find("Block 10: This block was not scanned"), std::string::npos);
  const std::vector<Row> identity = rows_below(html, "Measured slab");
  const Row* frame = row_of(identity, "slab frame");
  ASSERT_NE(frame, nullptr);
  ASSERT_GT(frame->size(), 1U);
  expect_mentions((*frame)[1], "not measured: 110: ");
  ASSERT_EQ(report("zh.html", "--full --language zh").status, 0);
  expect_mentions(content(file("zh.html")), "承轨台 10: 已扫描，未测量：该板已中止。");
}

TEST_F(ReportTest, a_block_that_was_not_found_has_no_row_of_deviations_and_no_normal) {
  measure(3);
  Attempt attempt;
  attempt.slab_key = 1;
  attempt.station = 4;
  attempt.number = 1;
  apply(AcquiredJob{attempt});
  BlockResult block = blocks_.back();
  block.station = 4;
  block.verdict = Verdict::not_measured;
  block.reason = 404;
  block.registration.status = RegistrationStatus::degenerate;
  block.seat = {};
  block.seat.plane.std_mm = 0.777;
  PlcResult record;
  record.kind = 1;
  record.res_seq = 4;
  record.station = 4;
  apply(BlockJob{1, 1, block, record});
  ASSERT_EQ(report("r.html", "--full").status, 0);
  const std::string html = content(file("r.html"));
  const std::vector<Row> deviations = rows_below(html, "Deviation of the registered points");
  EXPECT_NE(row_of(deviations, "3"), nullptr);
  EXPECT_EQ(row_of(deviations, "4"), nullptr);
  EXPECT_EQ(html.find("0.777"), std::string::npos) << "the scatter of a plane that is not there";
  const std::vector<Row> found = rows_below(html, "Block 3");
  const std::vector<Row> not_found = rows_below(html, "Block 4");
  for (const std::string axis : {"I", "J", "K"}) {
    const std::string label = "normal " + axis + ", to the slab top";
    ASSERT_NE(row_of(found, label), nullptr);
    ASSERT_NE(row_of(not_found, label), nullptr);
    EXPECT_NE((*row_of(found, label))[4], "-");
    EXPECT_EQ((*row_of(not_found, label))[4], "-");
    EXPECT_EQ((*row_of(not_found, label))[5], "-");
  }
}

TEST_F(ReportTest, pdf_svg_and_png_are_what_their_names_say_and_the_same_slab_gives_the_same_bytes) {
  make_slab();
  ASSERT_EQ(report("r.pdf").status, 0);
  const std::string pdf = content(file("r.pdf"));
  EXPECT_EQ(pdf.substr(0, 5), "%PDF-");
  ASSERT_EQ(report("again.pdf").status, 0);
  EXPECT_EQ(content(file("again.pdf")), pdf);
  ASSERT_EQ(report("r.svg", "--page 1").status, 0);
  expect_mentions(content(file("r.svg")).substr(0, 200), "<svg");
  ASSERT_EQ(report("r.png", "--page 2 --dpi 40").status, 0);
  EXPECT_EQ(content(file("r.png")).substr(1, 3), "PNG");
  EXPECT_FALSE(fs::exists(file("r.png.part")));
}

TEST_F(ReportTest, never_shows_pass_for_an_open_slab) {
  measure(1);
  ASSERT_EQ(report("r.html", "--full").status, 0);
  const std::string html = content(file("r.html"));
  expect_mentions(html, "<p class=\"verdict none\">still open</p>");
  expect_mentions(html, "This block was not scanned.");
  expect_mentions(html, "its verdict and the items of the slab are still to come");
  EXPECT_EQ(html.find("Every item was measured"), std::string::npos);
}

TEST_F(ReportTest, wrong_names_pages_and_places_are_refused_and_leave_nothing) {
  make_slab();
  Ended ended = report("r.doc");
  EXPECT_EQ(ended.status, 2);
  expect_mentions(ended.err, "must end in .pdf, .html, .svg or .png");
  ended = report("r.pdf", "--page 2");
  EXPECT_EQ(ended.status, 2);
  ended = report("r.svg", "--page 999");
  EXPECT_EQ(ended.status, 3);
  expect_mentions(ended.err, "page 999 does not exist; the report has ");
  ended = report("no/such/folder/r.pdf");
  EXPECT_EQ(ended.status, 3);
  expect_mentions(ended.err, "cannot be written");
  ended = report("no/such/folder/r.html");
  EXPECT_EQ(ended.status, 3);
  ended = run("report 77 --db " + file("slabd.db") + " --out " + file("r.pdf"));
  EXPECT_EQ(ended.status, 3);
  expect_mentions(ended.err, "no slab with key or id '77'");
  EXPECT_FALSE(fs::exists(file("r.pdf")));
}

TEST_F(ReportTest, every_word_exists_in_both_languages) {
  for (int i = 0; i <= static_cast<int>(report::Word::flatness_note); ++i) {
    const auto which = static_cast<report::Word>(i);
    EXPECT_FALSE(report::word(which, report::Language::en).empty()) << i;
    EXPECT_FALSE(report::word(which, report::Language::zh).empty()) << i;
  }
  for (std::size_t i = 0; i < kItemCount; ++i)
    for (const report::Language language : {report::Language::en, report::Language::zh})
      EXPECT_FALSE(report::item_word(static_cast<ItemId>(i), language).empty());
}

TEST(Figures, show_a_micrometre_a_ten_thousandth_of_a_degree_and_no_minus_zero) {
  EXPECT_EQ(report::figure(-0.0004, 3), "0.000");
  EXPECT_EQ(report::figure(-0.0006, 3), "-0.001");
  EXPECT_EQ(report::figure(kNoValue, 3), "-");
  Item item;
  item.id = ItemId::seat_slope;
  item.value = 1.43214;
  EXPECT_EQ(report::value_figure(item), "1.4321");
  EXPECT_EQ(report::deviation_figure(item), "-");
  EXPECT_EQ(report::limits_figure(item), "");
  item.id = ItemId::jaw_distance;
  item.upper = 1.0;
  EXPECT_EQ(report::limits_figure(item), "<= 1.000");
}

TEST(Figures, have_enough_digits_to_show_why_a_value_failed_by_a_small_amount) {
  Item item;
  item.id = ItemId::casing_spacing;
  item.nominal = 233.0;
  item.lower = 232.852;
  item.upper = 233.148;
  item.value = 233.14802;
  item.verdict = Verdict::fail;
  EXPECT_EQ(report::value_figure(item), "233.14802");
  EXPECT_EQ(report::deviation_figure(item), "0.14802");
  EXPECT_EQ(report::limits_figure(item), "232.85200 .. 233.14800");
  EXPECT_EQ(report::nominal_figure(item), "233.000");
  item.value = 232.851998;
  EXPECT_EQ(report::value_figure(item), "232.851998");
  EXPECT_EQ(report::limits_figure(item), "232.852000 .. 233.148000");
  // A difference that the usual digits show, one below all shown digits, and a value that did not fail.
  item.value = 233.149;
  EXPECT_EQ(report::value_figure(item), "233.149");
  EXPECT_EQ(report::limits_figure(item), "232.852 .. 233.148");
  item.value = 233.148 + 1e-12;
  EXPECT_EQ(report::value_figure(item), "233.148");
  item.value = 233.14802;
  item.verdict = Verdict::indeterminate;
  EXPECT_EQ(report::value_figure(item), "233.148");
}

}  // namespace
}  // namespace slabd::cli
