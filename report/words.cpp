// SPDX-License-Identifier: Apache-2.0
#include "report/words.h"

#include <fmt/core.h>

#include <array>
#include <cmath>
#include <utility>

#include "base/records.h"

namespace slabd::report {
namespace {

struct Entry {
  std::string_view en;
  std::string_view zh;
};
/// Words of an item. `meaning_zh` and `cure_zh`: of its reason, for items without a bit of the PLC
/// (ItemInfo::meaning).
struct ItemEntry {
  Entry name;
  std::string_view meaning_zh = {};
  std::string_view cure_zh = {};
};

Entry entry(Word word) {
  switch (word) {
    case Word::title: return {"Track slab inspection report", "轨道板检测报告"};
    case Word::overview: return {"Overview", "总览"};
    case Word::findings: return {"Findings", "不合格与待定项"};
    case Word::no_findings:
      return {"Every item was measured and is within its limits.", "全部项目均已测量并在限值内。"};
    case Word::no_findings_but:
      return {
          "Every item that the recipe requires was measured and is within its limits. Not required and not measured: "
          "{}.",
          "配方要求的项目均已测量并在限值内。配方不要求且未测量的项目：{} 个。"};
    case Word::more_findings: return {"and {} more, on the pages of the blocks", "另有 {} 项，见各承轨台"};
    case Word::warnings: return {"Notes", "注意事项"};
    case Word::identity: return {"Measured slab, and basis of the measurement", "检测对象与依据"};
    case Word::block: return {"Block {}", "承轨台 {}"};
    case Word::blocks: return {"Blocks", "承轨台"};
    case Word::slab_items: return {"Items of the slab", "整板检测项目"};
    case Word::seats: return {"The seats side by side", "各承轨面对比"};
    case Word::full_and_crop:
      return {
          "Seat plane: whole plane and evaluation region (normals in the registered block's frame: how the two fits "
          "agree; the slope itself is on each block's page)",
          "承轨面拟合：全平面与评定区域（法向量在配准后的承轨台坐标系中，用于比较两种拟合；坡度见各承轨台）"};
    case Word::registration_table: return {"Deviation of the registered points from the model", "配准偏差统计"};
    case Word::cycle_times: return {"Times: after the trigger in s, computing in ms", "节拍：触发后 s，计算 ms"};
    case Word::characteristic: return {"characteristic", "检测项目"};
    case Word::unit: return {"unit", "单位"};
    case Word::nominal: return {"nominal", "公称值"};
    case Word::limits: return {"limits", "限值"};
    case Word::measured: return {"measured", "实测值"};
    case Word::deviation: return {"deviation", "偏差"};
    case Word::uncertainty: return {"U (k = 2)", "扩展不确定度 U (k = 2)"};
    case Word::verdict: return {"verdict", "结论"};
    case Word::information: return {"information", "参考"};
    case Word::map_title: return {"Slab from above: verdict of every block", "轨道板俯视图：各承轨台结论"};
    case Word::map_alt: return {"Map of the slab with the verdict of each block:", "轨道板各承轨台结论图："};
    case Word::row_positive: return {"Y > 0", "Y > 0"};
    case Word::row_negative: return {"Y < 0", "Y < 0"};
    case Word::registration_map: return {"Deviation from the model, mm", "与模型的偏差，mm"};
    case Word::seat_map: return {"Deviation from the seat plane, mm", "与承轨面拟合平面的偏差，mm"};
    case Word::tolerance_chart: return {"Position of each value between its limits", "实测值在限值内的位置"};
    case Word::flatness: return {"flatness", "平面度"};
    case Word::standard_deviation: return {"standard deviation", "标准差"};
    case Word::chart_title: return {"Flatness and standard deviation of the seats, mm", "各承轨面平面度与标准差，mm"};
    case Word::points: return {"points", "点数"};
    case Word::mean: return {"mean", "平均值"};
    case Word::crop: return {"evaluation region", "评定区域"};
    case Word::full_plane: return {"whole plane", "全平面"};
    case Word::normal: return {"normal", "法向量"};
    case Word::normal_to_top: return {"normal {}, to the slab top", "法向量 {}（相对板顶面）"};
    case Word::inliers: return {"inliers", "内点"};
    case Word::attempts: return {"attempts", "扫描次数"};
    case Word::settle: return {"settled", "等待静止"};
    case Word::acquire: return {"acquired", "采集"};
    case Word::read: return {"read", "读取"};
    case Word::denoise: return {"denoise", "去噪"};
    case Word::register_step: return {"register", "配准"};
    case Word::extract: return {"extract", "提取"};
    case Word::total: return {"total", "合计"};
    case Word::evaluation_points: return {"evaluation cells", "个评定网格"};
    case Word::slab_id: return {"slab id", "板号"};
    case Word::slab_number: return {"slab number", "序号"};
    case Word::slab_type: return {"slab type", "板型"};
    case Word::database_key: return {"database key", "数据库键"};
    case Word::began: return {"began", "开始"};
    case Word::ended: return {"ended", "结束"};
    case Word::still_open: return {"still open", "未结束"};
    case Word::recipe: return {"recipe, SHA-256", "配方，SHA-256"};
    case Word::hand_eye: return {"hand-eye calibration", "手眼标定"};
    case Word::station_corrections: return {"station corrections", "检测位修正"};
    case Word::scanner_acceptance: return {"scanner acceptance", "扫描仪验收"};
    case Word::tie: return {"tie of the two robots", "两台机器人的基座关联"};
    case Word::scanner_not_verified:
      return {
          "The scanner had not been verified when this slab was begun: its part of U is the recipe's specification.",
          "该板开始时扫描仪未经验证：其不确定度分量取自配方的规格。"};
    case Word::budget: return {"Uncertainty budget, largest U of each", "不确定度预算（各检测项目最大 U）"};
    case Word::budget_note:
      return {
          "Parts are standard uncertainties (k = 1) in the characteristic's unit; U / 2 is their root sum of squares. "
          "Fit, noise, registration: from the scans. Scanner: the larger of recipe and acceptance ({}). Calibration, "
          "robot: hand-eye and station corrections. Reference, thermal: the recipe.",
          "各分量为标准不确定度 (k = 1)，单位同检测项目；U / 2 "
          "为其方和根。拟合、噪声、配准来自扫描；扫描仪取配方与验收（{}"
          "）中较大者；标定、机器人来自手眼标定与检测位修正；基准、温度来自配方。"};
    case Word::budget_note_tie:
      return {"Tie: place of the second robot's base, in items between stations of both robots.",
              "基座关联：第二台机器人底座的位置，见于两台机器人检测位之间的项目。"};
    case Word::block_column: return {"block", "承轨台"};
    case Word::budget_fit: return {"fit", "拟合"};
    case Word::budget_noise: return {"noise", "噪声"};
    case Word::budget_scanner: return {"scanner", "扫描仪"};
    case Word::budget_registration: return {"registr.", "配准"};
    case Word::budget_calibration: return {"calibr.", "标定"};
    case Word::budget_robot: return {"robot", "机器人"};
    case Word::budget_reference: return {"reference", "基准"};
    case Word::budget_thermal: return {"thermal", "温度"};
    case Word::budget_gauge: return {"gauge", "量具"};
    case Word::budget_tie: return {"tie", "基座关联"};
    case Word::software: return {"software", "软件"};
    case Word::acceptance: return {"decision rule", "判定规则"};
    case Word::guarded: return {"ISO 14253-1, guard band {} U", "ISO 14253-1，保护带 {} U"};
    case Word::simple_acceptance: return {"simple acceptance, no guard band", "简单接受，无保护带"};
    case Word::slab_fit: return {"slab frame", "板坐标系拟合"};
    case Word::slab_fit_value: return {"over {} seats, rms {} mm", "{} 个承轨面，均方根 {} mm"};
    case Word::scan_file: return {"scan", "扫描文件"};
    case Word::scanned: return {"scanned", "扫描时间"};
    case Word::none: return {"none", "无"};
    case Word::not_scanned: return {"This block was not scanned.", "该承轨台未扫描。"};
    case Word::not_measured_sentence: return {"This block could not be measured", "该承轨台未能测量"};
    case Word::not_measured_yet: return {"Scanned, not measured yet.", "已扫描，尚未测量。"};
    case Word::not_measured_aborted:
      return {"Scanned, not measured: the slab was aborted.", "已扫描，未测量：该板已中止。"};
    case Word::aborted_block: return {"no verdict: the slab was aborted", "无结论：该板已中止"};
    case Word::aborted_note:
      return {
          "The slab was aborted: its own items (position, height, spacing, slope in the slab's frame) were never "
          "judged, "
          "and a block that passed so far has no verdict.",
          "该板已中止：整板项目（位置、高低、间距、板坐标系中的坡度）从未判定，此前合格的承轨台没有结论。"};
    case Word::no_map:
      return {"No map was kept with this block: it was not found in its scan.",
              "该承轨台没有保存偏差图：扫描中未找到承轨台。"};
    case Word::unconfirmed:
      return {"{} nominals, tolerances and assumptions of the recipe had not been confirmed when this slab was judged.",
              "判定该板时，配方中有 {} 个公称值、公差或假设未经确认。"};
    case Word::not_visible:
      return {"Not visible to the scans of the blocks, and not judged: {} of the slab.",
              "承轨台扫描无法看到、未作判定：{}。"};
    case Word::gauges: return {"Gauges", "量具"};
    case Word::gauge: return {"gauge", "量具"};
    case Word::gauge_source: return {"source", "来源"};
    case Word::gauge_state: return {"state", "状态"};
    case Word::gauge_check: return {"master check: off by", "标准件校核偏差"};
    case Word::commissioning:
      return {"No calibration was in force: the robot and scanner were taken as the configuration states them.",
              "没有生效的标定：机器人与扫描仪按配置文件的值使用。"};
    case Word::open_warning:
      return {"The slab has not ended: its verdict and the items of the slab are still to come.",
              "该板尚未结束：整板结论与整板项目未出。"};
    case Word::outside_scale: return {"{} cells beyond the scale", "{} 个网格超出色标"};
    case Word::scale_note: return {"scale {} .. {} mm, the same for all blocks", "色标 {} .. {} mm，各承轨台相同"};
    case Word::defect:
      return {"Defect: {} mm² {} by up to {} mm at x {} mm, s {} mm",
              "缺陷：面积 {} mm²，{}，最大 {} mm，位置 x {} mm，s {} mm"};
    case Word::standing_out: return {"standing out", "凸起"};
    case Word::sunk: return {"sunk", "凹陷"};
    case Word::lower_end: return {"lower limit", "下限"};
    case Word::upper_end: return {"upper limit", "上限"};
    case Word::slab_word: return {"slab", "整板"};
    case Word::temperature: return {"slab temperature", "板温"};
    case Word::disposition: return {"disposition", "处置"};
    case Word::design: return {"design sheet", "设计表"};
    case Word::unknown_temperature: return {"unknown", "未知"};
    case Word::no_slab_temperature: return {"which no slab has: unknown", "超出轨道板的温度范围：按未知处理"};
    case Word::corrected_lengths:
      return {"lengths are corrected to the recipe's reference temperature", "长度已换算到配方的参考温度"};
    case Word::uncorrected_lengths:
      return {"lengths are not corrected, U contains the recipe's range", "长度未修正，U 已包含配方给出的温度范围"};
    case Word::as_measured: return {"at the slab's temperature", "板温下的实测值"};
    case Word::age: return {"slab age", "龄期"};
    case Word::mould: return {"mould", "模具"};
    case Word::key: return {"what", "名称"};
    case Word::value: return {"value", "内容"};
    case Word::page: return {"page {} of {}", "第 {} 页，共 {} 页"};
    case Word::pores: return {"Pores: {}", "气孔：{}"};
    case Word::edges: return {"Edges: {}", "棱边：{}"};
    case Word::refused: return {"Not measured: {}", "未测量：{}"};
    case Word::flatness_note:
      return {"with this noise a perfectly flat seat would read {} mm", "在该噪声下，理想平面的读数为 {} mm"};
  }
  return {};
}

constexpr std::string_view kGaugeCureZh = "slabctl show 列出各量具及其值；人工测量该板";

ItemEntry item_entry(ItemId id) {
  switch (id) {
    case ItemId::seat_slope: return {{"seat slope", "承轨面坡度"}};
    case ItemId::seat_flatness: return {{"seat flatness", "承轨面平面度"}};
    case ItemId::jaw_angle_inner: return {{"jaw angle, inner", "内侧钳口夹角"}};
    case ItemId::jaw_angle_outer: return {{"jaw angle, outer", "外侧钳口夹角"}};
    case ItemId::jaw_distance: return {{"jaw distance", "钳口距离"}};
    case ItemId::casing_spacing: return {{"casing spacing", "预埋套管间距"}};
    case ItemId::casing_protrusion_inner: return {{"casing protrusion, inner", "内侧套管凸起高度"}};
    case ItemId::casing_protrusion_outer: return {{"casing protrusion, outer", "外侧套管凸起高度"}};
    case ItemId::casing_skew_inner: return {{"casing skew, inner", "内侧套管歪斜"}};
    case ItemId::casing_skew_outer: return {{"casing skew, outer", "外侧套管歪斜"}};
    case ItemId::seat_lateral: return {{"seat, lateral position", "承轨面横向位置"}};
    case ItemId::seat_vertical: return {{"seat, height", "承轨面高低"}};
    case ItemId::seat_spacing: return {{"seat spacing", "承轨台间距"}};
    case ItemId::large_jaw_distance: return {{"large jaw distance", "大钳口距离"}};
    case ItemId::corner_level: return {{"corner level", "四角承轨面水平"}};
    case ItemId::warp_left: return {{"warp, row Y > 0", "翘曲（Y > 0）"}};
    case ItemId::warp_right: return {{"warp, row Y < 0", "翘曲（Y < 0）"}};
    case ItemId::seat_std: return {{"seat standard deviation", "承轨面测点标准差"}};
    case ItemId::surface_pores:
      return {{"pores, largest", "气孔（最大）"},
              "气孔的直径、深度或面积占比超过配方允许值",
              "slabctl show 给出位置、大小和深度；检查承轨台"};
    case ItemId::block_damage:
      return {{"damage, largest", "破损（最大）"},
              "承轨台表面有破损、裂缝、掉角或凸起",
              "slabctl show 给出位置、大小和深度；检查承轨台：破损、污物或遗留物"};
    case ItemId::slab_length: return {{"slab length", "板长"}, "板长超出限值", kGaugeCureZh};
    case ItemId::slab_width: return {{"slab width", "板宽"}, "板宽超出限值", kGaugeCureZh};
    case ItemId::slab_thickness: return {{"slab thickness", "板厚"}, "板厚超出限值", kGaugeCureZh};
    case ItemId::bottom_flatness: return {{"bottom flatness", "板底平面度"}, "板底不平", kGaugeCureZh};
  }
  return {};
}

constexpr std::array<const char*, kGaugeStates> kGaugeStatesZh = {"可用",
                                                                  "没有收到值",
                                                                  "属于另一块板",
                                                                  "值过旧",
                                                                  "超出量程",
                                                                  "远离公称值：单位或尺寸不对",
                                                                  "从未用标准件校核",
                                                                  "上次标准件校核超出限值",
                                                                  "标准件校核已过期"};

std::string_view pick(const Entry& entry, Language language) {
  return language == Language::zh ? entry.zh : entry.en;
}

constexpr std::array<const char*, kFindingKinds> kKindsZh = {"凹坑", "凸起", "裂缝", "掉角", "缺失"};
constexpr std::array<const char*, kFindingFaces> kFacesZh = {"承轨面", "内侧钳口面", "外侧钳口面", "内侧挡肩顶面",
                                                             "外侧挡肩顶面"};
constexpr std::array<const char*, kEdgeFaces> kEdgeFacesZh = {"承轨面",       "内侧钳口面",   "外侧钳口面",
                                                              "内侧挡肩顶面", "外侧挡肩顶面", "端面（x-）",
                                                              "端面（x+）",   "内侧侧面",     "外侧侧面"};
constexpr std::array<const char*, kPlaneDoubts> kPlaneDoubtsZh = {"",
                                                                  "",
                                                                  "各点不成平面",
                                                                  "拟合未收敛",
                                                                  "阈值内另有一个表面",
                                                                  "符合的点所占比例太小",
                                                                  "可见面积所占比例太小：点少处另有一个表面",
                                                                  "点太少、占面太小或噪声太大",
                                                                  "结果取决于阈值，如旁边另有一个表面",
                                                                  "另一平面所含的点数相近",
                                                                  "其中一部分由扫描软件填补，并非实测"};
constexpr std::array<const char*, kCasingDoubts> kCasingDoubtsZh = {"",
                                                                    "",
                                                                    "孔边可见部分太少，或不成圆",
                                                                    "孔半径偏差超过 1 mm",
                                                                    "孔口高度处有填塞物",
                                                                    "管口端面点太少",
                                                                    "管口端面上有高出承轨面的异物",
                                                                    "管口端面一周不成平整平面",
                                                                    "其中一部分由扫描软件填补，并非实测"};

}  // namespace

std::string_view code(Language language) {
  return language == Language::zh ? "zh" : "en";
}

std::string_view word(Word which, Language language) {
  return pick(entry(which), language);
}

std::string item_word(ItemId id, Language language) {
  return std::string(pick(item_entry(id).name, language));
}

ReasonWords item_reason_zh(ItemId id) {
  const ItemEntry words = item_entry(id);
  return {words.meaning_zh, words.cure_zh};
}

std::string emulation_notice(std::uint8_t bits, Language language) {
  if (bits == 0) return {};
  struct Part {
    std::string_view en;
    std::string_view zh;
  };
  static constexpr std::array<Part, kEmulationNames.size()> kParts = {{
      {"[line] simulation = true", "[line] simulation = true"},
      {"robot emulated", "机器人为仿真"},
      {"robot poses commanded, not measured", "机器人位姿为指令值，非实测"},
      {"scan emulated", "扫描为仿真"},
  }};
  const bool zh = language == Language::zh;
  std::string parts;
  for (std::size_t i = 0; i < kParts.size(); ++i) {
    if ((bits & (1U << i)) == 0) continue;
    if (!parts.empty()) parts += zh ? "，" : ", ";
    parts += zh ? kParts[i].zh : kParts[i].en;
  }
  return zh ? fmt::format("仿真（{}）：不是对混凝土实物的结论", parts)
            : fmt::format("EMULATED ({}): no verdict on concrete", parts);
}

unsigned emulation_bit(std::string_view name) {
  for (std::size_t i = 0; i < kEmulationNames.size(); ++i)
    if (kEmulationNames[i] == name) return 1U << i;
  return 0;
}

std::string emulation_banner(std::uint8_t shown, std::uint8_t now, Language language) {
  if (shown == 0 || now != 0) return emulation_notice(shown, language);
  return emulation_notice(shown, language) +
         (language == Language::zh ? "（所示轨道板；生产线当前非仿真）" : "; it is the slab shown, not the line now");
}

std::string_view emulation_mark(std::uint8_t bits, Language language) {
  if (bits == 0) return {};
  return language == Language::zh ? "仿真" : "EMULATED";
}

std::string gauge_state_sentence(GaugeState state, Language language) {
  if (language == Language::zh) return kGaugeStatesZh.at(static_cast<std::size_t>(state));
  return std::string(state == GaugeState::ok ? name(state) : reason_of(state));
}

std::string_view verdict_word(Verdict verdict, Language language) {
  switch (verdict) {
    case Verdict::none: return pick({"none", "无"}, language);
    case Verdict::pass: return pick({"pass", "合格"}, language);
    case Verdict::fail: return pick({"FAIL", "不合格"}, language);
    case Verdict::not_measured: return pick({"not measured", "未测量"}, language);
    case Verdict::aborted: return pick({"aborted", "已中止"}, language);
    case Verdict::indeterminate: return pick({"indeterminate", "无法判定"}, language);
  }
  return "";
}

std::string finding_sentence(const SurfaceFinding& f, Language language) {
  if (language == Language::en) return std::string(sentence(f).view());
  std::string text =
      fmt::format("{}{}，位置 x {:.0f} mm，s {:.0f} mm，{:.0f} x {:.0f} mm，{:.0f} mm²",
                  kFacesZh.at(static_cast<std::size_t>(f.face)), kKindsZh.at(static_cast<std::size_t>(f.kind)), f.x_mm,
                  f.s_mm, f.length_mm, f.width_mm, f.area_mm2);
  if (has_value(f.depth_mm))
    text += fmt::format("，最{} {:.1f} mm", f.kind == FindingKind::bump ? "高" : "深", f.depth_mm);
  return text;
}

std::string finding_mark(const SurfaceFinding& f, Language language) {
  return fmt::format("{} {:.0f} x {:.0f}",
                     language == Language::zh ? kKindsZh.at(static_cast<std::size_t>(f.kind)) : name(f.kind).data(),
                     f.length_mm, f.width_mm);
}

std::string pore_sentence(const PoreSummary& pores, Language language) {
  if (language == Language::en || !has_value(pores.largest_mm)) return std::string(sentence(pores).view());
  const auto limit = [](bool exceeded, double value, const char* unit) {
    return has_value(value) ? fmt::format("（{} {:g} {}）", exceeded ? "超过" : "不超过", value, unit) : std::string();
  };
  std::string text =
      fmt::format("{} 个，最大 {:.1f} mm，最深 {:.1f} mm", pores.count, pores.largest_mm, pores.deepest_mm);
  text += limit(is_too_deep(pores), pores.limits.depth_max_mm, "mm");
  if (!has_value(pores.share)) return text;
  text += fmt::format("，占面积 {:.2f} %", 100.0 * pores.share);
  return text + limit(is_too_much(pores), 100.0 * pores.limits.share_max, "%");
}

std::string refusal_sentence(const BlockResult& block, Language language) {
  const bool zh = language == Language::zh;
  std::string text;
  const auto add = [&](const char* feature, const char* feature_zh, std::string_view reason, const char* reason_zh) {
    if (reason.empty()) return;
    text += text.empty() ? "" : zh ? "；" : "; ";
    text += zh ? fmt::format("{}：{}", feature_zh, reason_zh) : fmt::format("{}: {}", feature, reason);
  };
  const auto add_plane = [&](const char* feature, const char* feature_zh, const PlaneFit& plane) {
    if (!plane.ok)
      add(feature, feature_zh, reason_of(plane.doubt), kPlaneDoubtsZh.at(static_cast<std::size_t>(plane.doubt)));
  };
  const auto add_casing = [&](const char* feature, const char* feature_zh, const CasingFeature& casing) {
    if (!casing.ok)
      add(feature, feature_zh, reason_of(casing.doubt), kCasingDoubtsZh.at(static_cast<std::size_t>(casing.doubt)));
  };
  add_plane("seat", "承轨面", block.seat.plane);
  add_plane("slab top", "板顶面", block.slab_top);
  add_plane("inner jaw", "内侧钳口面", block.jaw_inner);
  add_plane("outer jaw", "外侧钳口面", block.jaw_outer);
  add_casing("inner casing", "内侧套管", block.casing_inner);
  add_casing("outer casing", "外侧套管", block.casing_outer);
  return text;
}

std::string edge_sentence(const BlockResult& block, Language language) {
  const bool zh = language == Language::zh;
  const auto face = [&](EdgeFace which) {
    return zh ? kEdgeFacesZh.at(static_cast<std::size_t>(which)) : name(which).data();
  };
  std::string text;
  const auto add = [&](const std::string& part) { text += (text.empty() ? "" : zh ? "，" : ", ") + part; };
  // A group has one nominal, printed after its last item.
  double nominal_mm = kNoValue;
  const auto end_group = [&] {
    if (has_value(nominal_mm)) text += fmt::format(fmt::runtime(zh ? "（公称 {:g}）" : " (nominal {:g})"), nominal_mm);
    nominal_mm = kNoValue;
  };
  bool named = false;
  for (const bool of_seat : {true, false}) {
    for (const EdgeFeature& edge : block.edges) {
      if (!has_value(edge.radius_mm) || (edge.face == EdgeFace::seat) != of_seat) continue;
      add(fmt::format("{}{:.1f} mm {}/{}",
                      named ? ""
                      : zh  ? "圆角 "
                            : "fillet ",
                      edge.radius_mm, face(edge.face), face(edge.face_to)));
      named = true;
      nominal_mm = edge.nominal_mm;
    }
    end_group();
  }
  named = false;
  for (const bool of_sides : {false, true}) {
    double low = kNoValue;
    double high = kNoValue;
    for (const EdgeFeature& edge : block.edges) {
      const bool at_side = edge.face_to == EdgeFace::side_inner || edge.face_to == EdgeFace::side_outer;
      if (!has_value(edge.chamfer_mm) || at_side != of_sides) continue;
      low = std::fmin(low, edge.chamfer_mm);
      high = std::fmax(high, edge.chamfer_mm);
      nominal_mm = edge.nominal_mm;
    }
    if (!has_value(low)) continue;
    const char* where = zh ? (of_sides ? "侧面" : "端面") : of_sides ? "sides" : "ends";
    add(fmt::format("{}{:.1f}..{:.1f} mm {}", named ? "" : zh ? "倒角 " : "chamfer ", low, high, where));
    named = true;
  }
  end_group();
  return text;
}

std::string reason_sentence(std::uint16_t reason, Language language) {
  if (reason == 0) return "";
  if (const std::optional<ItemId> item = item_from_reason(reason); item && info(*item).plc_bit >= 0) {
    // Both warps share a bit of the PLC's mask; the items distinguish them.
    if (*item == ItemId::warp_left) return language == Language::zh ? "翘曲" : "warp";
    return item_word(*item, language);
  }
  return fmt::format("{}{}{}", reason, language == Language::zh ? "：" : ": ",
                     meaning(static_cast<Code>(reason), language));
}

}  // namespace slabd::report
