// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "report/canvas.h"
#include "report/table.h"
#include "report/words.h"
#include "storage/storage.h"

/// What a report says, before it is known on what. Pages (PDF, SVG, PNG) and HTML are two ways to lay it out.
namespace slabd::cli::report {

struct Paragraph {
  std::string text;
  Verdict verdict = Verdict::none;  ///< a symbol before it, none: none
  bool warning = false;
};
/// Drawn in a box of this size (mm) whose upper left corner is the origin.
struct Figure {
  std::string title;
  std::string alt;  ///< what there is to see, for who cannot see it
  double width_mm = 0.0;
  double height_mm = 0.0;
  std::function<void(Canvas&)> draw;
};
/// Side by side.
struct Figures {
  std::vector<Figure> list;
};
using Part = std::variant<Paragraph, Table, Figures>;

struct Section {
  std::string title;
  Verdict verdict = Verdict::none;
  std::string remark;  ///< beside the title
  bool new_page = false;
  bool together = false;  ///< not broken over two pages
  std::vector<Part> parts;
};

struct Report {
  Language language = Language::en;
  std::string title;
  std::string subject;  ///< the slab, in a few words; stands on every page
  bool judged = true;   ///< false: the document is about no single slab and has no verdict
  Verdict verdict = Verdict::none;
  bool open = false;
  std::int64_t ended_utime_us = 0;
  std::uint8_t emulated = 0;  ///< emulation bits; a watermark and a notice on every page
  std::vector<Section> sections;
};

/// A map as it is drawn: heights row by row, NaN where nothing was seen.
struct DrawnMap {
  std::size_t columns = 0;
  std::size_t rows = 0;
  double cell_mm = 0.0;
  std::vector<float> heights_mm;
};

/// A stored slab with the maps of the valid attempts, [station - 1]; nothing where none was kept.
struct SlabPicture {
  const storage::SlabRecord* record = nullptr;
  std::array<std::optional<DrawnMap>, limits::kStationsMax> registration;
  std::array<std::optional<DrawnMap>, limits::kStationsMax> seat;
  /// Both ends of the colour scales, the same for all blocks.
  double registration_scale_mm = 0.1;
  double seat_scale_mm = 0.02;
};

/// Reads and unpacks the maps. An error is the database's.
[[nodiscard]] Result<std::unique_ptr<SlabPicture>> picture_of(storage::Reader& reader,
                                                              const storage::SlabRecord& record);

/// `picture` must outlive the report.
[[nodiscard]] Report compose(const SlabPicture& picture, Language language);

/// Of each characteristic the largest U with its parts; nothing when no budget was computed.
[[nodiscard]] std::optional<Table> budget_table(const storage::SlabRecord& record, Language language);

// ---- drawings ----------------------------------------------------------------------------------------------------

[[nodiscard]] Figure slab_map_figure(const storage::SlabRecord& record, Language language);
[[nodiscard]] Figure registration_figure(const SlabPicture& picture, int station, Language language);
[[nodiscard]] Figure seat_figure(const SlabPicture& picture, int station, Language language);
[[nodiscard]] Figure tolerance_figure(std::span<const Item> items, Language language);
[[nodiscard]] Figure seats_figure(const storage::SlabRecord& record, Language language);

// ---- laying out ----------------------------------------------------------------------------------------------------

inline constexpr double kPageWidth_mm = 210.0;
inline constexpr double kPageHeight_mm = 297.0;

/// Lays the report out; the first call of `draw_page(p)` may come after `pages()` only.
class Pages {
 public:
  explicit Pages(const Report& report);
  ~Pages();
  Pages(const Pages&) = delete;
  Pages& operator=(const Pages&) = delete;
  [[nodiscard]] int count() const;
  void draw(int page, Canvas& canvas) const;

 private:
  struct Layout;
  std::unique_ptr<Layout> layout_;
};

/// Writes all pages into one PDF, or one page (or all, below each other, when `page` is 0) as SVG or PNG.
/// config: what could not be written; nothing is left behind then.
[[nodiscard]] Status write_pdf(const Report& report, const std::string& path);
[[nodiscard]] Status write_svg(const Report& report, int page, const std::string& path);
[[nodiscard]] Status write_png(const Report& report, int page, double dots_per_inch, const std::string& path);
/// A document that needs nothing else: inline SVG, tables with scopes, a description for every figure.
[[nodiscard]] std::string html(const Report& report);
/// config: it cannot be written; nothing is left behind then.
[[nodiscard]] Status write_html(const Report& report, const std::string& path);
/// One drawing as an SVG element whose ids begin with `prefix`.
[[nodiscard]] std::string svg_of(const Figure& figure, const std::string& prefix);

}  // namespace slabd::cli::report
