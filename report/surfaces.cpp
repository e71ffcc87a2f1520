// SPDX-License-Identifier: Apache-2.0
//
// Writes pages to a PDF, an SVG or a PNG.
#include <cairo-pdf.h>
#include <cairo-svg.h>
#include <cairo.h>

#include <cmath>
#include <ctime>

#include "base/durable.h"
#include "report/content.h"
#include "report/json.h"

namespace slabd::report {
namespace {

constexpr double kPointsPerMm = 72.0 / 25.4;
/// Cairo's limit of an image's side.
constexpr double kPixelsMax = 32'000.0;

cairo_status_t put(void* file, const unsigned char* bytes, unsigned int count) {
  auto& out = *static_cast<OutFile*>(file);
  out.write(bytes, count);
  return out.good() ? CAIRO_STATUS_SUCCESS : CAIRO_STATUS_WRITE_ERROR;
}

/// Renames the file to `path`, unless Cairo or the disk reported an error.
Status keep(OutFile& file, const std::string& path, cairo_status_t status) {
  if (file.good() && status != CAIRO_STATUS_SUCCESS)
    return error(Code::config, "%s cannot be written: %s", path.c_str(), cairo_status_to_string(status));
  return file.close();
}

void draw_on(cairo_t* context, const Pages& pages, int page, double scale, double from_top_mm) {
  // Without a surface the caller reports the error; Cairo leaks the memory of drawing on none.
  if (cairo_status(context) != CAIRO_STATUS_SUCCESS) return;
  cairo_save(context);
  cairo_scale(context, scale, scale);
  cairo_translate(context, 0.0, from_top_mm);
  Canvas canvas(context);
  canvas.rectangle(0.0, 0.0, kPageWidth_mm, kPageHeight_mm, kWhite);
  pages.draw(page, canvas);
  cairo_restore(context);
}

/// Draws one page, or all below each other.
void draw_stack(cairo_t* context, const Pages& pages, int page, double scale) {
  if (page > 0) {
    draw_on(context, pages, page - 1, scale, 0.0);
    return;
  }
  for (int p = 0; p < pages.count(); ++p) draw_on(context, pages, p, scale, p * kPageHeight_mm);
}

Status check_page(const Pages& pages, int page) {
  if (page >= 0 && page <= pages.count()) return success();
  return error(Code::config, "page %d does not exist; the report has %d", page, pages.count());
}

cairo_status_t append(void* text, const unsigned char* bytes, unsigned int count) {
  static_cast<std::string*>(text)->append(reinterpret_cast<const char*>(bytes), count);
  return CAIRO_STATUS_SUCCESS;
}

/// Puts `prefix` before every id and every reference to one, so that several drawings can share a document.
std::string with_prefix(const std::string& text, const std::string& prefix) {
  std::string out;
  for (std::size_t at = 0; at < text.size();) {
    bool found = false;
    for (const std::string_view mark : {" id=\"", "href=\"#", "url(#"}) {
      if (text.compare(at, mark.size(), mark) != 0) continue;
      out += mark;
      out += prefix;
      at += mark.size();
      found = true;
      break;
    }
    if (!found) out += text[at++];
  }
  return out;
}

}  // namespace

Status write_pdf(const Report& report, const std::string& path) {
  const Pages pages(report);
  OutFile file(path, {.synced = true});
  if (!file.good()) return file.close();
  cairo_surface_t* surface =
      cairo_pdf_surface_create_for_stream(put, &file, kPageWidth_mm * kPointsPerMm, kPageHeight_mm * kPointsPerMm);
  cairo_pdf_surface_set_metadata(surface, CAIRO_PDF_METADATA_TITLE, (report.title + ", " + report.subject).c_str());
  cairo_pdf_surface_set_metadata(surface, CAIRO_PDF_METADATA_CREATOR, "slabd");
  // The same slab gives the same file, because the date is the slab's and not today's.
  cairo_pdf_surface_set_metadata(surface, CAIRO_PDF_METADATA_CREATE_DATE,
                                 iso_time(report.ended_utime_us == 0 ? 1 : report.ended_utime_us).c_str());
  cairo_t* context = cairo_create(surface);
  for (int page = 0; page < pages.count(); ++page) {
    draw_on(context, pages, page, kPointsPerMm, 0.0);
    cairo_show_page(context);
  }
  const cairo_status_t drawn = cairo_status(context);
  cairo_destroy(context);
  cairo_surface_finish(surface);
  const cairo_status_t written = cairo_surface_status(surface);
  cairo_surface_destroy(surface);
  return keep(file, path, drawn != CAIRO_STATUS_SUCCESS ? drawn : written);
}

Status write_svg(const Report& report, int page, const std::string& path) {
  const Pages pages(report);
  if (Status status = check_page(pages, page); !status.ok()) return status;
  OutFile file(path, {.synced = true});
  if (!file.good()) return file.close();
  const int stacked = page > 0 ? 1 : pages.count();
  cairo_surface_t* surface = cairo_svg_surface_create_for_stream(put, &file, kPageWidth_mm * kPointsPerMm,
                                                                 stacked * kPageHeight_mm * kPointsPerMm);
  cairo_t* context = cairo_create(surface);
  draw_stack(context, pages, page, kPointsPerMm);
  const cairo_status_t drawn = cairo_status(context);
  cairo_destroy(context);
  cairo_surface_finish(surface);
  const cairo_status_t written = cairo_surface_status(surface);
  cairo_surface_destroy(surface);
  return keep(file, path, drawn != CAIRO_STATUS_SUCCESS ? drawn : written);
}

Status write_png(const Report& report, int page, double dots_per_inch, const std::string& path) {
  const Pages pages(report);
  if (Status status = check_page(pages, page); !status.ok()) return status;
  const double scale = dots_per_inch / 25.4;
  const double height = (page > 0 ? 1 : pages.count()) * kPageHeight_mm * scale;
  if (height > kPixelsMax)
    return error(Code::config, "%d pages at %.0f dpi are %.0f pixels high, at most %.0f; name a page or a lower --dpi",
                 pages.count(), dots_per_inch, height, kPixelsMax);
  OutFile file(path, {.synced = true});
  if (!file.good()) return file.close();
  cairo_surface_t* surface = cairo_image_surface_create(
      CAIRO_FORMAT_RGB24, static_cast<int>(std::lround(kPageWidth_mm * scale)), static_cast<int>(std::lround(height)));
  cairo_t* context = cairo_create(surface);
  draw_stack(context, pages, page, scale);
  const cairo_status_t drawn = cairo_status(context);
  cairo_destroy(context);
  const cairo_status_t written = cairo_surface_write_to_png_stream(surface, put, &file);
  cairo_surface_destroy(surface);
  return keep(file, path, drawn != CAIRO_STATUS_SUCCESS ? drawn : written);
}

std::string svg_of(const Figure& figure, const std::string& prefix) {
  std::string text;
  cairo_surface_t* surface = cairo_svg_surface_create_for_stream(append, &text, figure.width_mm * kPointsPerMm,
                                                                 figure.height_mm * kPointsPerMm);
  cairo_t* context = cairo_create(surface);
  cairo_scale(context, kPointsPerMm, kPointsPerMm);
  Canvas canvas(context);
  figure.draw(canvas);
  cairo_destroy(context);
  cairo_surface_finish(surface);
  cairo_surface_destroy(surface);
  const std::size_t begin = text.find("<svg");
  return begin == std::string::npos ? std::string() : with_prefix(text.substr(begin), prefix);
}

}  // namespace slabd::report
