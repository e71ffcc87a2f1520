// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "base/os.h"
#include "base/result.h"

/// Runs slabd-cad, which reads and writes CAD files, as a limited process. OpenCASCADE's readers crash on damaged
/// files and may need any memory and time; the process ends then, and slabctl reports one sentence.
namespace slabd::cli {

/// Address space of the process: of it 250 MB are libraries; a slab needs 150 MB more.
inline constexpr std::uint64_t kCadAddressBytesMax = 1'000'000'000;
inline constexpr int kCadProcessor_s = 30;
/// By the clock. A busy computer gives a process half of a core.
inline constexpr int kCadClock_s = 90;
/// Largest result: the file of a slab with tolerances has 6 MB, the findings of a slab 4 MB.
inline constexpr std::uint64_t kCadOutputBytesMax = 64'000'000;
/// Largest file that is read.
inline constexpr std::uint64_t kCadInputBytesMax = 64'000'000;

struct CadAnswer {
  std::string output;
  std::string note;  ///< first line of its stderr
};

/// Path of slabd-cad: the environment's SLABD_CAD, else next to slabctl. scanner_offline: it is not installed.
[[nodiscard]] Result<std::string> cad_program();

/// Content of a file; a pipe is read as far as it has content. config: it cannot be read, or has more bytes.
[[nodiscard]] Result<std::string> read_bounded(const std::string& path, std::uint64_t bytes_max);

/// Runs the program with `input` as standard input. `what` begins the sentences: "block.stp". config: the program
/// refused the input, crashed, or exceeded a limit; the text is one sentence. internal: no process.
[[nodiscard]] Result<CadAnswer> run_cad(const std::string& program, const std::vector<std::string>& arguments,
                                        std::string_view input, const std::string& what);

}  // namespace slabd::cli
