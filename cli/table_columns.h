// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <CLI/CLI.hpp>
#include <string>

#include "hal/hal.h"

namespace slabd::cli {

/// The option --columns of a command that reads scan files; `text` must outlive the command.
inline void add_columns(CLI::App& command, std::string& text) {
  command
      .add_option("--columns", text,
                  "Of a table (.xyz .asc .txt .csv): which columns are x, y and z, by name or by number from 1, as in "
                  "PosX,PosY,PosZ or 2,3,4")
      ->check([](const std::string& given) {
        const Result<hal::TableColumns> columns = hal::parse_table_columns(given);
        return columns.ok() ? std::string() : std::string(columns.error().text.view());
      });
}

/// What the option checked.
[[nodiscard]] inline hal::TableColumns columns_of(const std::string& text) {
  return text.empty() ? hal::TableColumns{} : hal::parse_table_columns(text).value();
}

}  // namespace slabd::cli
