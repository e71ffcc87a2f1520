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

/// A table as a value. A command computes it once; the terminal, CSV, JSON, HTML and the pages are ways to write it.
namespace slabd::cli {

class Json;

struct Style {
  bool colour = false;
  bool unicode = false;
};

/// One character: pass, fail, indeterminate, not measured, aborted, none.
[[nodiscard]] std::string_view symbol(Verdict verdict, Style style);
/// Symbol and word, coloured: "✓ pass".
[[nodiscard]] std::string verdict_text(Verdict verdict, Style style);
/// In the colour of these SGR parameters, where there is colour.
[[nodiscard]] std::string coloured(std::string_view text, std::string_view sgr, Style style);
/// In the verdict's colour.
[[nodiscard]] std::string coloured(std::string_view text, Verdict verdict, Style style);
/// Columns that a text takes in a terminal: escape sequences none, Chinese characters two, others one.
[[nodiscard]] std::size_t display_width(std::string_view text);

/// The text that people read. Of a number also its value with every digit, for programs.
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
  /// A heading that ends with '<' is of words, which are aligned left; with '?' of a column that people see only if one
  /// of its cells has a text. Without a name for programs the column is for people only.
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

/// Without the optional columns that have nothing to show.
[[nodiscard]] Table visible(const Table& table);
/// Of the last cell that has one, else none.
[[nodiscard]] Verdict verdict_of(const Table::Row& row);

[[nodiscard]] std::string cell_text(const Cell& cell, Style style);
/// For a terminal: cells are padded by what they look like and not by their bytes; the first column is aligned left.
[[nodiscard]] std::string text_of(const Table& table, Style style = {});

/// Who will open a CSV. A spreadsheet program takes a text that begins with = + - @ or a control character for a
/// formula and computes it; in a table for one it gets an apostrophe before it. A program gets the text as it is.
/// Numbers are the same for both.
enum class TableFor : std::uint8_t { program, spreadsheet };
/// RFC 4180, of the columns with a key. Numbers have every digit and a full stop whatever the locale; what is not there
/// is an empty field, never 0.
[[nodiscard]] std::string csv_heading(const Table& table);
[[nodiscard]] std::string csv_rows(const Table& table, TableFor reader);
/// `name: [{key: value, ...}, ...]`; a text that is empty and a number that is not finite are null.
void write_rows(Json& json, std::string_view name, const Table& table);

}  // namespace slabd::cli
