// SPDX-License-Identifier: Apache-2.0
#include "cli/terminal/table_columns.h"

#include "cli/terminal/arguments.h"

namespace slabd::cli {

void add_columns(args::Command& command, std::string& text) {
  command
      .add_option("--columns", text,
                  "Of a table (.xyz .asc .txt .csv): which columns are x, y and z, by name or by number from 1, as in "
                  "PosX,PosY,PosZ or 2,3,4")
      ->check([](const std::string& given) {
        const Result<hal::TableColumns> columns = hal::parse_table_columns(given);
        return columns.ok() ? std::string() : std::string(columns.error().text.view());
      });
}

hal::TableColumns columns_of(const std::string& text) {
  return text.empty() ? hal::TableColumns{} : hal::parse_table_columns(text).value();
}

}  // namespace slabd::cli
