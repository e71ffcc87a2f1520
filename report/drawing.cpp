// SPDX-License-Identifier: Apache-2.0
#include "report/drawing.h"

#include <cairo.h>

#include <cmath>

#include "base/durable.h"

namespace slabd::report {
namespace {

cairo_status_t put(void* file, const unsigned char* bytes, unsigned int count) {
  auto& out = *static_cast<OutFile*>(file);
  out.write(bytes, count);
  return out.good() ? CAIRO_STATUS_SUCCESS : CAIRO_STATUS_WRITE_ERROR;
}

}  // namespace

Status write_drawing(const std::string& path, double width_mm, double height_mm, double dots_per_inch,
                     const std::function<void(Canvas&)>& draw) {
  OutFile file(path);
  if (!file.good()) return file.close();
  const double scale = dots_per_inch / 25.4;
  cairo_surface_t* surface =
      cairo_image_surface_create(CAIRO_FORMAT_RGB24, static_cast<int>(std::lround(width_mm * scale)),
                                 static_cast<int>(std::lround(height_mm * scale)));
  cairo_t* context = cairo_create(surface);
  cairo_status_t status = cairo_status(context);
  if (status == CAIRO_STATUS_SUCCESS) {
    cairo_scale(context, scale, scale);
    Canvas canvas(context);
    canvas.rectangle(0.0, 0.0, width_mm, height_mm, kWhite);
    draw(canvas);
    status = cairo_status(context);
  }
  cairo_destroy(context);
  if (status == CAIRO_STATUS_SUCCESS) status = cairo_surface_write_to_png_stream(surface, put, &file);
  cairo_surface_destroy(surface);
  if (file.good() && status != CAIRO_STATUS_SUCCESS)
    return error(Code::config, "%s cannot be written: %s", path.c_str(), cairo_status_to_string(status));
  return file.close();
}

}  // namespace slabd::report
