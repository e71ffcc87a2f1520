// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <concepts>
#include <cstdint>
#include <initializer_list>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

#include "base/base.h"
#include "report/figures.h"

/// A table as a value. A command computes it once; it is written to the terminal, CSV, JSON, HTML and the pages.
namespace slabd::report {

class Json;

struct Style {
  bool colour = false;
  bool unicode = false;
};

/// One character: pass, fail, indeterminate, not measured, aborted, none.
[[nodiscard]] std::string_view symbol(Verdict verdict, Style style);
/// Symbol and word, coloured: "✓ pass".
[[nodiscard]] std::string verdict_text(Verdict verdict, Style style);
/// Text in the colour of these SGR parameters if the style has colour.
[[nodiscard]] std::string coloured(std::string_view text, std::string_view sgr, Style style);
/// Text in the verdict's colour.
[[nodiscard]] std::string coloured(std::string_view text, Verdict verdict, Style style);
/// Columns of a text in a terminal: escape sequences have zero, Chinese characters two, others one.
[[nodiscard]] std::size_t display_width(std::string_view text);

/// Text for people. A number has also its value with every digit, for programs.
struct Cell {
  template <typename T>
  requires std::convertible_to<const T&, std::string_view> Cell(const T& words)  // NOLINT(google-explicit-constructor)
      : text(std::string_view(words)) {}
  template <typename T>
  requires requires(const T& words) { words.view().size(); }
  Cell(const T& words) : text(words.view()) {}  // NOLINT(google-explicit-constructor)
  template <std::integral T>
  Cell(T count) : text(std::to_string(count)), number(static_cast<std::int64_t>(count)) {}  // NOLINT
  Cell(double value);  // NOLINT(google-explicit-constructor): every digit
  Cell(double value, int decimals) : text(figure(value, decimals)), number(value) {}
  /// `words` instead of the verdict's name.
  Cell(Verdict v, std::string_view words) : text(words), verdict(v) {}
  Cell(Verdict v) : Cell(v, name(v)) {}  // NOLINT(google-explicit-constructor)

  std::string text;
  std::variant<std::monostate, std::int64_t, double> number;
  std::optional<Verdict> verdict;  ///< its symbol is written in front of the text
};

struct Column {
  /// A heading that ends with '<' marks a text column, aligned left. One with '?' marks a column that is shown only if
  /// a cell has a text. A column without a name for programs is for people only.
  Column(std::string_view words, std::string name_for_programs);
  template <typename T>
  requires std::convertible_to<const T&, std::string_view> Column(const T& words)
      : Column(std::string_view(words), "") {}  // NOLINT(google-explicit-constructor)

  std::string heading;
  std::string key;
  bool left = false;
  bool optional = false;
};

struct Table {
  using Row = std::vector<Cell>;

  Table() = default;
  Table(std::initializer_list<Column> of_columns) : columns(of_columns) {}
  template <typename... T>
  void add(T&&... cells) {
    rows.push_back({Cell(std::forward<T>(cells))...});
  }

  std::string title;  ///< a document's caption; a terminal does not show it
  std::vector<Column> columns;
  std::vector<Row> rows;
};

/// The table without optional columns that are empty.
[[nodiscard]] Table visible(const Table& table);
/// Verdict of the last cell that has one; Verdict::none if none has.
[[nodiscard]] Verdict verdict_of(const Table::Row& row);

[[nodiscard]] std::string cell_text(const Cell& cell, Style style);
/// The table for a terminal: cells are padded by display width, not bytes; the first column is aligned left.
[[nodiscard]] std::string text_of(const Table& table, Style style = {});

/// Reader of a CSV. A spreadsheet program evaluates a text that begins with = + - @ or a control character as a
/// formula; for one, such a text is prefixed with an apostrophe. A program gets the text as it is. Numbers are the
/// same for both.
enum class TableFor : std::uint8_t { program, spreadsheet };
/// RFC 4180, only columns with a key. Numbers have every digit and a full stop whatever the locale; a missing value is
/// an empty field, never 0.
[[nodiscard]] std::string csv_heading(const Table& table);
[[nodiscard]] std::string csv_rows(const Table& table, TableFor reader);
/// Writes `name: [{key: value, ...}, ...]`; empty texts and numbers that are not finite are null.
void write_rows(Json& json, std::string_view name, const Table& table);

}  // namespace slabd::report
