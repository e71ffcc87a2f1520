// SPDX-License-Identifier: Apache-2.0
//
// slabd-cad: writes and reads STEP and IGES for slabctl, which starts it with limits (cli/cad). It reads standard input
// and writes standard output; it opens no other file for writing and no connection.
//
//   slabd-cad export step|ap214|iges <ORDER.json >FILE     the model of a slabd.cad_model/1
//   slabd-cad import step|iges REFERENCE_MM <FILE >FOUND   what was found in the file: slabd.cad_findings/1
//
// Status: 0 done, 2 usage, 3 the input cannot be used (one sentence on stderr), 5 internal.
#include <fmt/core.h>
#include <unistd.h>

#include <Message.hxx>
#include <Message_Messenger.hxx>
#include <Standard_Failure.hxx>

#include <cstdio>
#include <cstdlib>
#include <iostream>
#include <iterator>
#include <new>
#include <sstream>
#include <string>
#include <string_view>

#include "cad/finder.h"
#include "cad/read_faces.h"
#include "cad/sandbox.h"
#include "cad/write_model.h"

namespace slabd::cad {
namespace {

enum Exit : int { kDone = 0, kUsage = 2, kBadInput = 3, kInternal = 5 };

int complain(int status, std::string_view sentence) {
  fmt::print(stderr, "slabd-cad: {}\n", sentence);
  return status;
}

int stop(const Error& why) {
  return complain(why.code == Code::internal ? kInternal : kBadInput, why.text.view());
}

int export_model(std::string_view form) {
  const std::string text((std::istreambuf_iterator<char>(std::cin)), std::istreambuf_iterator<char>());
  const Result<ModelOrder> order = parse_order(text);
  if (!order) return stop(order.error());
  std::ostringstream out;
  const Form as = form == "iges" ? Form::iges : form == "ap214" ? Form::step_ap214 : Form::step_ap242;
  const Result<WrittenModel> written = write_model(order.value(), as, out);
  if (!written) return stop(written.error());
  const std::string bytes = out.str();
  if (std::fwrite(bytes.data(), 1, bytes.size(), stdout) != bytes.size() || std::fflush(stdout) != 0)
    return complain(kInternal, "the file cannot be written");
  fmt::print(stderr, "{} {:.17g}\n", written.value().faces, written.value().volume_mm3);
  return kDone;
}

int import_model(std::string_view form, double reference_mm, bool confined) {
  const Result<FaceList> faces = read_faces("/dev/stdin", form == "iges");
  if (!faces) return stop(faces.error());
  const Findings findings = find_slab(faces.value(), reference_mm);
  const std::string text = findings_json(faces.value(), findings, confined);
  if (std::fwrite(text.data(), 1, text.size(), stdout) != text.size() || std::fflush(stdout) != 0)
    return complain(kInternal, "the findings cannot be written");
  return kDone;
}

int run(int argc, const char* const* argv) {
  const std::string_view verb = argc > 1 ? argv[1] : "";
  const std::string_view form = argc > 2 ? argv[2] : "";
  if (verb == "--version") {
    fmt::print("{}\n", SLABD_VERSION);
    return kDone;
  }
  const bool is_form = form == "step" || form == "iges" || (verb == "export" && form == "ap214");
  const bool is_export = verb == "export" && argc == 3 && is_form;
  const bool is_import = verb == "import" && argc == 4 && is_form;
  if (!is_export && !is_import)
    return complain(kUsage, "usage: slabd-cad export step|ap214|iges, or slabd-cad import step|iges REFERENCE_MM");
  const bool confined = confine();
  // stdout is the result; OpenCASCADE's messages would be in it.
  Message::DefaultMessenger()->ChangePrinters().Clear();
  return is_export ? export_model(form) : import_model(form, std::atof(argv[3]), confined);
}

}  // namespace
}  // namespace slabd::cad

int main(int argc, char** argv) {
  int status = slabd::cad::kInternal;
  try {
    status = slabd::cad::run(argc, argv);
  } catch (const Standard_Failure& fault) {
    status = slabd::cad::complain(slabd::cad::kBadInput,
                                  fmt::format("the geometry cannot be used: {}", fault.DynamicType()->Name()));
  } catch (const std::bad_alloc&) {
    status = slabd::cad::complain(slabd::cad::kBadInput, "the file needs more memory than is allowed");
  } catch (const std::exception& fault) {
    status = slabd::cad::complain(slabd::cad::kBadInput, fault.what());
  }
  // The result is written; a damaged file must not crash OpenCASCADE's destructors after it.
  std::fflush(nullptr);
  ::_exit(status);
}
