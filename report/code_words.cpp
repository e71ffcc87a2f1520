// SPDX-License-Identifier: Apache-2.0
//
// Codes, warnings and states in Chinese. The English texts are in base/result.h and the daemon's status; a test checks
// that this list is complete.
#include <array>
#include <utility>

#include "base/calibration.h"
#include "base/plc.h"
#include "report/words.h"

namespace slabd::report {
namespace {

struct CodeWords {
  Code code;
  ReasonWords words;
};

constexpr std::array kCodesZh = {
    CodeWords{Code::unknown_command, {"命令字不是 1 至 5", "在 PLC 程序中更正 CMD（HR 10）"}},
    CodeWords{Code::stale_session,
              {"命令带有旧的会话号", "重新读取 SESSION（IR 9），写入 SESSION_ECHO（HR 38），再写一次命令"}},
    CodeWords{Code::busy,
              {"上一条命令仍在执行，或等待 RES_ACK 的结果过多",
               "等待 BUSY（IR 5 位 1）清除；若已清除，确认待取的结果（IR 20、HR 2）"}},
    CodeWords{Code::wrong_slab,
              {"没有打开的轨道板，命令指向另一块板，或在已有打开的板时发送了 SLAB_BEGIN",
               "IR 14-15 为打开的板：先 SLAB_END 或 SLAB_ABORT；没有打开的板时先 SLAB_BEGIN；直到 SLAB_END 之前 "
               "SLAB_NO 不得改变"}},
    CodeWords{Code::station_range, {"检测位号不在 1 至承轨台数之间", "更正 STATION（HR 11）"}},
    CodeWords{Code::unknown_type,
              {"该板型没有可用的配方，或扫描显示的是另一板型的板端",
               "添加或修复配方文件（每种板型只放一个）；slabctl config check 会指出错误；若在 SCAN 之后出现：更正 "
               "SLAB_TYPE（HR 12）"}},
    CodeWords{Code::not_enabled,
              {"ENABLE 未置位、PLC 心跳缺失，或正在标定（状态 8）",
               "置位 HR 1 位 0，并至少每 500 ms 改变 HR 0；状态 8 时请等待或结束标定"}},
    CodeWords{Code::bad_id_text,
              {"SLAB_ID 不是可打印的 ASCII、不符合 [line] id_pattern 规定的板号格式，或与板内第二枚芯片的板号不同",
               "更正 HR 16 至 31；板号格式见配置中的 [line] id_pattern；若两枚芯片不同或第二枚未读出（HR "
               "35），请查明是哪块板"}},
    CodeWords{Code::bad_crc, {"CMD_CRC 与 HR 10 至 36 不符，或命令块的字节顺序颠倒", "重写命令块；检查字节序和字序"}},
    CodeWords{Code::interrupted,
              {"命令因重启或 ABORT 而中断，或该板以 SLAB_ABORT 结束",
               "重新发送命令；已中止的板没有结论，用 SLAB_BEGIN 重新测量"}},
    CodeWords{Code::bad_sequence, {"CMD_SEQ 既不是 CMD_ACK 也不是其后继", "以 CMD_ACK（IR 10） 为起点，逐一递增"}},
    CodeWords{Code::no_design,
              {"没有该板的设计表，或设计表属于其他板型",
               "把设计表放入 `[design] dir`；`slabctl doctor` 指出有错误的文件（docs/CURVE_SLABS.md）"}},
    CodeWords{Code::unknown_mould,
              {"MOULD 与 SLAB_ID 给出的模具不一致，或 SLAB_ID 中的模具号不在 0 至 65535 之间",
               "更正 MOULD（HR 34）或 SLAB_ID（HR 16 至 31），或更正配置中的 [line] mould_from_id"}},
    CodeWords{Code::no_gauge,
              {"量具没有可用的值：缺失、过旧、属于另一块板、不可信，或标准件校核已到期",
               "slabctl gauge list 列出量具和原因；用标准件校核（slabctl gauge check）；PLC 在 SLAB_END 之前先写 "
               "GAUGE_SLAB_NO，再写 GAUGE_SEQ（HR 72）（docs/GAUGES.md）"}},
    CodeWords{
        Code::attempts_used_up,
        {"该检测位在此轨道板中已扫描 255 次，达到计数上限", "结束或中止此轨道板并重新开始；查明该检测位为何反复扫描"}},
    CodeWords{Code::no_pose, {"没有收到机器人位姿", "启动机器人位姿转发程序；检查网络接口和组播路由"}},
    CodeWords{Code::pose_stale, {"最新的机器人位姿过旧", "检查机器人位姿转发程序及其网络"}},
    CodeWords{Code::not_settled,
              {"机器人未静止", "SCAN 之前多等一会；slabctl robot monitor 显示位姿的离散和丢失；检查机器人抱闸"}},
    CodeWords{Code::outside_window, {"扫描仪未对准指令检测位", "检查检测位号、机器人程序和 [cell] T_base_slab"}},
    CodeWords{Code::moved_during_scan, {"扫描期间机器人移动", "重新扫描该检测位"}},
    CodeWords{Code::wrong_frame,
              {"位姿不是法兰在机器人基坐标系中的位姿", "在机器人程序中将 $TOOL 和 $BASE 设为 $NULLFRAME"}},
    CodeWords{Code::scanner_offline,
              {"扫描仪不可用：交换目录、共享或连接", "检查路径、权限和挂载；数据流方式时检查网关及其连接"}},
    CodeWords{Code::trigger_timeout, {"扫描仪未按时响应", "检查扫描仪程序；重新扫描"}},
    CodeWords{Code::frame_incomplete, {"扫描不完整、无法读取，或不是所请求的那次扫描", "重新扫描该检测位"}},
    CodeWords{Code::exposure, {"保留：扫描过曝或欠曝", "检查扫描仪的曝光设置"}},
    CodeWords{Code::too_few_points, {"有效点过少", "检查距离、曝光和污物；重新扫描"}},
    CodeWords{Code::block_not_found, {"未找到承轨台，或该检测位未扫描", "检查检测位、板的位置以及承轨台是否在位"}},
    CodeWords{Code::fit_failed, {"必需特征无法测量", "重新扫描；检查污物或缺损表面"}},
    CodeWords{Code::ambiguous, {"保留：扫描与承轨台的匹配不唯一", "让整个承轨台进入视场后重新扫描"}},
    CodeWords{Code::deadline,
              {"测量被放弃：工作量过大，或测量期间 slabd 结束；或没有空闲缓冲区",
               "用 slabctl inspect 查看该扫描，然后重新扫描；检查计算机负载"}},
    CodeWords{
        Code::store_full,
        {"磁盘已满，或空间不足以存放两块板", "清理扫描存储目录或数据库所在的磁盘；journalctl -u slabd 会说明是哪一个"}},
    CodeWords{Code::journal_write,
              {"数据库或扫描存储目录无法写入，或数据库已损坏或不存在",
               "slabctl status 和 journalctl -u slabd 会说明是哪一种；检查磁盘及其挂载，然后复位故障；"
               "若有程序长期锁住数据库，会给出其进程号（slabctl doctor 也会给出），请结束该程序；"
               "slabctl db check 可判断数据库是否损坏，slabctl db restore 可恢复备份"}},
    CodeWords{Code::calibration_missing,
              {"没有有效的标定", "进行标定并启用；从未标定过的产线取配置中的 [calibration]"}},
    CodeWords{Code::config, {"配置不可用", "运行 slabctl config check；它会指出文件和行"}},
    CodeWords{Code::internal, {"内部检查失败", "记录日志条目并重启服务"}},
};

constexpr std::array<std::pair<std::uint16_t, std::string_view>, 16> kWarningsZh = {{
    {kWarnUnconfirmedNominals, "结论依赖于未经确认的公称值或公差"},
    {kWarnCommissioningCalibration, "使用调试标定值：尚未启用任何标定"},
    {kWarnStrayFiles, "不对应任何请求的文件已移至 stray/"},
    {kWarnResultsWaiting, "等待 RES_ACK 的结果超过一块板"},
    {kWarnClockBackwards, "系统时钟早于最新记录"},
    {kWarnRecipeUnusable, "有配方文件不可用"},
    {kWarnDiskLow, "磁盘已满或将满，已拒绝一条命令"},
    {kWarnControlSocket, "控制套接字无法打开"},
    {kWarnCheckOverdue, "参考块或监测球的检查已逾期（slabctl calibrate check）"},
    {kWarnStationsNotCorrected, "有检测位未经修正测量；不确定度取决于机器人精度"},
    {kWarnScannerNotVerified, "扫描仪未经验证：从未验证、已过期、超出限值或温度不同（slabctl scanner verify）"},
    {kWarnHandednessUnproven, "扫描仪坐标系的手性未经证实：现用标定没有证明手性的视图"},
    {kWarnRecipesDiffer, "配方文件夹与正在使用的配方不一致"},
    {kWarnEmulation, "仿真：机器人或扫描仪不是真实设备"},
    {kWarnGauge, "某个量具卡滞，或其标准件校核缺失、未通过或已过期（slabctl gauge list）"},
    {kWarnStopsAlike, "机器人在相邻承轨台上的停位相同，位姿无法证明扫描属于哪个承轨台"},
}};

constexpr std::array<std::pair<std::string_view, std::string_view>, 9> kStatesZh = {{
    {"init", "启动中"},
    {"recover", "恢复中"},
    {"idle", "空闲"},
    {"slab_open", "轨道板检测中"},
    {"settling", "等待机器人静止"},
    {"scanning", "扫描中"},
    {"waiting_for_plc", "等待 PLC"},
    {"fault", "故障"},
    {"maintenance", "维护"},
}};

/// Empty if the code has no Chinese words.
ReasonWords chinese(Code code) {
  for (const CodeWords& known : kCodesZh)
    if (known.code == code) return known.words;
  const std::optional<ItemId> item = item_from_reason(static_cast<int>(code));
  return item ? item_reason_zh(*item) : ReasonWords{};
}

}  // namespace

std::string_view meaning(Code code, Language language) {
  const ReasonWords words = language == Language::zh ? chinese(code) : ReasonWords{};
  return words.meaning.empty() ? describe(code) : words.meaning;
}

std::string_view cure_words(Code code, Language language) {
  const ReasonWords words = language == Language::zh ? chinese(code) : ReasonWords{};
  return words.cure.empty() ? cure(code) : words.cure;
}

std::string_view warning_zh(std::uint16_t bit) {
  for (const auto& [known, text] : kWarningsZh)
    if (known == bit) return text;
  return {};
}

std::string_view state_word(std::string_view state, Language language) {
  if (language == Language::zh)
    for (const auto& [english, text] : kStatesZh)
      if (english == state) return text;
  return state;
}

}  // namespace slabd::report
