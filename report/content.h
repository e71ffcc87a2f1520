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

/// Content of a report, independent of the medium. Pages (PDF, SVG, PNG) and HTML lay it out.
namespace slabd::report {

struct Paragraph {
  std::string text;
  Verdict verdict = Verdict::none;  ///< its symbol precedes the text; Verdict::none: no symbol
  bool warning = false;
};
/// A drawing in a box of this size (mm) with the upper left corner at the origin.
struct Figure {
  std::string title;
  std::string alt;  ///< description of the drawing for readers who cannot see it
  double width_mm = 0.0;
  double height_mm = 0.0;
  std::function<void(Canvas&)> draw;
};
/// Figures next to each other.
struct Figures {
  std::vector<Figure> list;
};
using Part = std::variant<Paragraph, Table, Figures>;

struct Section {
  std::string title;
  Verdict verdict = Verdict::none;
  std::string remark;     ///< next to the title
  bool together = false;  ///< the section is kept on one page
  /// The section fills the rest of a page, its own or a later one; on paper it is left out if none has room.
  bool filler = false;
  std::vector<Part> parts;
};

struct Report {
  Language language = Language::en;
  std::string title;
  std::string subject;  ///< the slab in a few words; printed on every page
  bool judged = true;   ///< false: the document is not about a single slab and has no verdict
  Verdict verdict = Verdict::none;
  bool open = false;
  std::int64_t ended_utime_us = 0;
  std::uint8_t emulated = 0;  ///< emulation bits; a watermark and a notice on every page
  std::vector<Section> sections;
};

/// A map as drawn: heights row by row, NaN for cells without data.
struct DrawnMap {
  std::size_t columns = 0;
  std::size_t rows = 0;
  double cell_mm = 0.0;
  std::vector<float> heights_mm;
};

/// A stored slab with the maps of the valid attempts, [station - 1]; nullopt if no map was stored.
struct SlabPicture {
  const storage::SlabRecord* record = nullptr;
  std::vector<storage::CalibrationRecord> calibrations;  ///< those that the slab names, if they are stored
  std::array<std::optional<DrawnMap>, limits::kStationsMax> registration;
  std::array<std::optional<DrawnMap>, limits::kStationsMax> seat;
  /// The colour scales run from minus to plus these values and are the same for all blocks.
  double registration_scale_mm = 0.1;
  double seat_scale_mm = 0.02;
};

/// Reads and decompresses the maps. Errors are those of the database.
[[nodiscard]] Result<std::unique_ptr<SlabPicture>> picture_of(storage::Reader& reader,
                                                              const storage::SlabRecord& record);

struct Choice {
  Language language = Language::en;
  bool full = false;    ///< all blocks, and the tables of the whole slab; otherwise the blocks with findings
  std::string project;  ///< empty: not printed
};
/// `picture` must outlive the report.
[[nodiscard]] Report compose(const SlabPicture& picture, const Choice& choice);

/// Table of the largest U of each characteristic with its parts; nullopt if no budget was computed.
[[nodiscard]] std::optional<Table> budget_table(const storage::SlabRecord& record, Language language);

// ---- drawings ----------------------------------------------------------------------------------------------------

[[nodiscard]] Figure slab_map_figure(const storage::SlabRecord& record, Language language);
[[nodiscard]] Figure registration_figure(const SlabPicture& picture, int station, Language language);
[[nodiscard]] Figure seat_figure(const SlabPicture& picture, int station, Language language);
[[nodiscard]] Figure tolerance_figure(std::span<const Item> items, Language language);
[[nodiscard]] Figure seats_figure(const storage::SlabRecord& record, Language language);
/// Lines for names, dates and signatures; above them boxes for the decision on a slab that did not pass. At the right
/// the SLAB_ID as a Data Matrix, if it is not empty.
[[nodiscard]] Figure signature_figure(bool with_disposition, std::string_view slab_id, Language language);

// ---- layout --------------------------------------------------------------------------------------------------------

inline constexpr double kPageWidth_mm = 210.0;
inline constexpr double kPageHeight_mm = 297.0;

/// The report laid out on A4 pages. Pages count from 0.
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
/// Code::config if a file cannot be written; in that case no partial file remains.
[[nodiscard]] Status write_pdf(const Report& report, const std::string& path);
[[nodiscard]] Status write_svg(const Report& report, int page, const std::string& path);
[[nodiscard]] Status write_png(const Report& report, int page, double dots_per_inch, const std::string& path);
/// A self-contained document: inline SVG, tables with scopes, a description for every figure.
[[nodiscard]] std::string html(const Report& report);
/// Code::config if the file cannot be written; in that case no partial file remains.
[[nodiscard]] Status write_html(const Report& report, const std::string& path);
/// One drawing as an SVG element whose ids begin with `prefix`.
[[nodiscard]] std::string svg_of(const Figure& figure, const std::string& prefix);

}  // namespace slabd::report
