// SPDX-License-Identifier: Apache-2.0
//
// Language of the tree: words and openings that readers with another first language misread, in comments, documents,
// messages and names of tests. Each rule is a pattern; the allowed lines are listed here with a reason.
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <filesystem>
#include <fstream>
#include <regex>
#include <set>
#include <string>
#include <vector>

#include "tests/places/places.h"

namespace {

namespace fs = std::filesystem;

struct Rule {
  const char* name;
  std::vector<std::string> parts;  ///< one of them is in each match; regular expressions alone take a minute
  std::regex pattern;
};
/// Rules of every text.
const std::array<Rule, 5> kWords = {{
    {"name the actor",
     {"body", "one", "hoever"},
     std::regex(R"(\b([Nn]obody|[Ss]omebody|[Ww]hoever|[Ee]verybody|[Ss]omeone|[Ee]veryone)\b)")},
    {"\"is not a\", \"does not\"",
     {" no"},
     std::regex(R"(\b([Tt]here )?(is|are|was|were) no\b(?! (longer|more|less|later|larger|smaller|better|worse|)"
                R"(shorter|slower|faster|further|wider|higher|lower|fewer|earlier)\b))")},
    {"a quantity has a name", {"so m"}, std::regex(R"(\bso (many|much)\b)")},
    {"again, permanently, also",
     {"ever", "anew", "likewise", "thereby", "herein", "whereof"},
     std::regex(R"(\b(for ever|forever|anew|likewise|thereby|herein|whereof)\b)")},
    {"data does not speak",
     {" told", " so", " asked", " believed", "vouch"},
     std::regex(R"(\b(is told|are told|says so|is asked|are asked|is believed|vouch\w*)\b)")},
}};
/// Openings that the first line of a comment or a paragraph must not have.
const std::regex kOpening(R"(^(What|Who|Whoever|Whether|Of|Where|So|And)\b(?!.*\?))");

struct Exception {
  const char* file;
  const char* text;
  const char* reason;
};
constexpr std::array<Exception, 5> kExceptions = {{
    {"tests/cli/export_test.cpp", "belongs to user nobody", "the name of an account"},
    {"tests/hal/system/journal_test.cpp", "\"nobody\"", "the name of a socket"},
    {"tests/systemd/unit_test.py", "nobody", "the name of an account"},
    {"script/cached", "'made anew'", "part of a checksum; another text would compile every header again"},
    {"tests/base/prose_test.cpp", "", "the rules themselves"},
}};

bool is_excepted(const std::string& file, const std::string& line) {
  return std::any_of(kExceptions.begin(), kExceptions.end(),
                     [&](const Exception& e) { return file == e.file && line.find(e.text) != std::string::npos; });
}

/// A piece of prose in a line.
struct Piece {
  std::string text;
  bool opens = false;  ///< the first line of a comment or a paragraph
};

std::string trimmed(const std::string& text) {
  const std::size_t from = text.find_first_not_of(" \t");
  return from == std::string::npos ? "" : text.substr(from);
}

/// Splits the lines of a file into pieces of prose.
class Reader {
 public:
  explicit Reader(const fs::path& path) : extension_(path.extension()) {}

  std::vector<Piece> pieces(const std::string& line) {
    if (extension_ == ".md") return paragraph(line);
    if (extension_ == ".json") return description(line);
    if (extension_ == ".cpp" || extension_ == ".h") return code(line);
    std::vector<Piece> found = remark(line, line.find(mark()), mark().size());
    found.push_back({line, false});  // its strings
    return found;
  }

 private:
  /// Start of a comment.
  [[nodiscard]] std::string mark() const {
    if (extension_ == ".sql") return "--";
    if (extension_ == ".st") return "(*";
    return extension_ == ".scl" || extension_ == ".udt" ? "//" : "#";
  }
  /// The description in a line of a JSON schema.
  static std::vector<Piece> description(const std::string& line) {
    static const std::string key = "\"description\": \"";
    const std::size_t at = line.find(key);
    if (at == std::string::npos) return {};
    return {{line.substr(at + key.size()), true}};
  }
  std::vector<Piece> paragraph(const std::string& line) {
    const std::string text = trimmed(line);
    if (text.empty() || text.front() == '#') {  // a heading may be a question
      inside_ = false;
      return {{text, false}};
    }
    static const std::regex item(R"(^([-*|]|\d+\.)\s*)");
    const bool opens = text.front() != '|' && (!inside_ || std::regex_search(text, item));
    inside_ = true;
    return {{std::regex_replace(text, item, ""), opens}};
  }
  /// A comment from `at` on; it continues the one of the line before if nothing is in front of it.
  std::vector<Piece> remark(const std::string& line, std::size_t at, std::size_t marks) {
    if (at == std::string::npos) {
      inside_ = false;
      return {};
    }
    const bool whole = trimmed(line).size() == line.size() - at;
    std::string text = line.substr(at + marks);
    text = trimmed(text.substr(std::min(text.find_first_not_of("/!<#"), text.size())));
    const bool opens = !(whole && inside_);
    inside_ = whole && !text.empty();
    return {{text, opens}};
  }
  /// Comment and string literals of a line. A literal opens unless it continues the one before it.
  std::vector<Piece> code(const std::string& line) {
    std::vector<Piece> found;
    std::size_t comment = std::string::npos;
    bool opens = !after_literal_;
    after_literal_ = false;
    for (std::size_t i = 0; i < line.size(); ++i) {
      if (line.compare(i, 2, "//") == 0) {
        comment = i;
        break;
      }
      if (line[i] != '"') {
        const bool is_space = line[i] == ' ';
        opens = opens || !is_space;
        after_literal_ = after_literal_ && is_space;
        continue;
      }
      const std::size_t from = i + 1;
      for (++i; i < line.size() && line[i] != '"'; ++i)
        if (line[i] == '\\') ++i;
      found.push_back({line.substr(from, std::min(i, line.size()) - from), opens});
      opens = false;
      after_literal_ = true;
    }
    for (Piece& piece : remark(line, comment, 2)) found.push_back(std::move(piece));
    return found;
  }

  std::string extension_;
  bool inside_ = false;         ///< the line before belongs to the same comment or paragraph
  bool after_literal_ = false;  ///< the line before ended with a literal
};

/// Every text file of the tree that people write.
std::vector<fs::path> files() {
  const fs::path root(slabd::places::source_dir());
  static const std::set<std::string> kinds = {".cpp",   ".h",     ".md",      ".py",  ".toml",
                                              ".txt",   ".cmake", ".catalog", ".sql", ".service",
                                              ".timer", ".conf",  ".st",      ".scl", ".udt"};
  static const std::set<std::string> skipped = {"build",        ".git", "corpus", "apt-packages",
                                                "node_modules", "dist", "axe"};
  std::vector<fs::path> found;
  for (auto it = fs::recursive_directory_iterator(root); it != fs::recursive_directory_iterator(); ++it) {
    if (it->is_directory() && skipped.contains(it->path().filename())) it.disable_recursion_pending();
    if (!it->is_regular_file()) continue;
    const fs::path folder = it->path().parent_path();
    const bool script = folder == root / "script" && it->path().extension().empty();
    const bool schema = folder == root / "docs/schemas" && it->path().extension() == ".json";
    const bool package = folder == root / "debian" || folder == root / "debian/man";
    if (script || schema || package || kinds.contains(it->path().extension())) found.push_back(it->path());
  }
  return found;
}

/// Lines of a file that break a rule, "file:line: rule: text".
std::vector<std::string> slips(const fs::path& path, const std::string& name) {
  std::vector<std::string> found;
  Reader reader(path);
  std::ifstream in(path);
  std::string line;
  for (int number = 1; std::getline(in, line); ++number)
    for (const Piece& piece : reader.pieces(line)) {
      const auto report = [&](const char* rule) {
        if (!is_excepted(name, line)) found.push_back(name + ":" + std::to_string(number) + ": " + rule + ": " + line);
      };
      for (const Rule& rule : kWords) {
        const auto in_piece = [&](const std::string& part) { return piece.text.find(part) != std::string::npos; };
        if (std::none_of(rule.parts.begin(), rule.parts.end(), in_piece)) continue;
        std::smatch match;
        // "There is no file" names what is missing.
        if (std::regex_search(piece.text, match, rule.pattern) && !match.str(1).ends_with("here ")) report(rule.name);
      }
      if (piece.opens && std::regex_search(piece.text, kOpening)) report("the first sentence names the thing");
    }
  return found;
}

TEST(Prose, in_the_tree_obeys_the_rules) {
  const fs::path root(slabd::places::source_dir());
  std::size_t read = 0;
  for (const fs::path& path : files()) {
    ++read;
    for (const std::string& slip : slips(path, fs::relative(path, root).generic_string())) ADD_FAILURE() << slip;
  }
  EXPECT_GT(read, 900U);
}

TEST(Prose, rules_find_what_they_look_for) {
  const fs::path path = fs::temp_directory_path() / ("prose_test_" + std::to_string(::getpid()) + ".cpp");
  std::ofstream(path) << "// Whether it works.\n"
                         "// Of the second line this is not an opening.\n"
                         "int a = 0;  // nobody reads it\n"
                         "const char* b = \"it is no number\";\n"
                         "const char* c = \"there is no file // in a string\";\n"
                         "add(\"--by\", \"Who measured \"\n"
                         "    \"Of these words this is not an opening\");\n"
                         "// Why does it work? It is no longer broken.\n";
  const std::vector<std::string> found = slips(path, "x.cpp");
  fs::remove(path);
  ASSERT_EQ(found.size(), 4U);
  EXPECT_TRUE(found[0].starts_with("x.cpp:1: "));
  EXPECT_TRUE(found[1].starts_with("x.cpp:3: "));
  EXPECT_TRUE(found[2].starts_with("x.cpp:4: "));
  EXPECT_TRUE(found[3].starts_with("x.cpp:6: "));
}

TEST(Prose, rules_hold_in_comments_of_every_language_and_in_descriptions) {
  struct Sample {
    const char* extension;
    const char* text;
  };
  constexpr std::array<Sample, 6> samples = {{{".sql", "a INTEGER,  -- Whether it is used"},
                                              {".st", "a : INT;  (* Whether it is used *)"},
                                              {".scl", "a : Int;  // Whether it is used"},
                                              {".service", "# Whether it is used"},
                                              {".py", "say('nobody reads it')"},
                                              {".json", "\"a\": {\"description\": \"What it is\"}"}}};
  for (const Sample& sample : samples) {
    const fs::path path = fs::temp_directory_path() / ("prose_test_" + std::to_string(::getpid()) + sample.extension);
    std::ofstream(path) << sample.text << '\n';
    EXPECT_EQ(slips(path, "x").size(), 1U) << sample.extension;
    fs::remove(path);
  }
}

TEST(Prose, lines_of_markdown_have_at_most_120_columns_except_in_tables_and_code) {
  const fs::path root(slabd::places::source_dir());
  for (const fs::path& path : files()) {
    if (path.extension() != ".md") continue;
    std::ifstream in(path);
    std::string line;
    for (int number = 1; std::getline(in, line); ++number) {
      const auto columns = std::count_if(line.begin(), line.end(), [](char c) { return (c & 0xC0) != 0x80; });  // UTF-8
      if (columns > 120 && !line.starts_with("|") && !line.starts_with("    "))
        ADD_FAILURE() << fs::relative(path, root) << ":" << number << ": " << columns << " columns";
    }
  }
}

TEST(Prose, names_of_test_cases_are_in_snake_case_and_obey_the_rules) {
  // Upper case is left to abbreviations: at least two capitals, or one alone as a symbol.
  static const std::regex test(R"(^TEST(_F|_P)?\((\w+), (\w+)\))");
  static const std::regex camel(R"([a-z][A-Z]|(^|_)[A-Z][a-z])");
  static const std::regex abbreviations("NaNs?|NULs");
  static const std::regex opening("^(what|who|whoever|whether|of|where|so|and)_");
  static const std::regex words(
      "(^|_)(nobody|somebody|whoever|everybody|anew|likewise|forever|so_many|so_much|(is|are|was|were)_no|"
      "(is|are)_(told|asked|believed)|says_so)(_|$)");
  static const std::regex comparison(
      "(is|are|was|were)_no_(longer|more|less|later|larger|smaller|better|worse|narrower)");
  std::size_t cases = 0;
  for (const fs::path& path : files()) {
    if (path.extension() != ".cpp") continue;
    std::ifstream in(path);
    std::string line;
    std::smatch match;
    while (std::getline(in, line)) {
      if (!line.starts_with("TEST") || !std::regex_search(line, match, test)) continue;
      ++cases;
      const std::string name = match.str(3);
      EXPECT_FALSE(std::regex_search(std::regex_replace(name, abbreviations, ""), camel)) << path << ": " << name;
      EXPECT_FALSE(std::regex_search(name, opening)) << path << ": " << name;
      EXPECT_FALSE(std::regex_search(std::regex_replace(name, comparison, ""), words)) << path << ": " << name;
    }
  }
  EXPECT_GT(cases, 2'000U);
}

}  // namespace
