// SPDX-License-Identifier: Apache-2.0
//
// Published schemas of the documents that the programs write and read: docs/schemas, and the list of them. The
// conformity of the documents is tested in export_test, study_test, slabctl_test and
// tests/line/documents_line_test.cpp.
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <regex>
#include <set>
#include <sstream>
#include <string>
#include <vector>

#include "tests/places/places.h"

namespace slabd::cli {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

const fs::path kSource = places::source_dir();

std::string content(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  std::ostringstream text;
  text << in.rdbuf();
  return text.str();
}

/// All files; common contains the shared parts of the schemas and does not describe a document.
std::map<std::string, json> schema_files() {
  std::map<std::string, json> schemas;
  for (const fs::directory_entry& entry : fs::directory_iterator(kSource / "docs/schemas"))
    if (entry.path().extension() == ".json")
      schemas.emplace(entry.path().stem().string(), json::parse(content(entry.path())));
  return schemas;
}

std::map<std::string, json> published() {
  std::map<std::string, json> schemas = schema_files();
  EXPECT_EQ(schemas.erase("common"), 1U);
  return schemas;
}

/// "slab/1" of every "slabd.slab/1" in the programs' source without comments, which may name other versions.
std::set<std::string> named_in_the_source() {
  std::set<std::string> names;
  const std::regex name(R"(slabd\.([a-z_]+/[0-9]+))");
  for (const char* room : {"calib", "cli", "config", "daemon", "emulator", "hal", "plant", "report", "storage", "web"})
    for (const fs::directory_entry& entry : fs::recursive_directory_iterator(kSource / room)) {
      if (entry.path().extension() != ".cpp" && entry.path().extension() != ".h") continue;
      std::istringstream text(content(entry.path()));
      for (std::string line; std::getline(text, line);) {
        line = line.substr(0, line.find("//"));
        for (std::sregex_iterator at(line.begin(), line.end(), name), end; at != end; ++at) names.insert((*at)[1]);
      }
    }
  return names;
}

/// The published list of schemas with their descriptions.
std::string list_of(const std::map<std::string, json>& schemas) {
  std::string list = "| Schema | Document |\n|---|---|\n";
  for (const auto& [name, schema] : schemas)
    list += "| [" + schema["title"].get<std::string>() + "](" + name + ".json) | " +
            schema["description"].get<std::string>() + " |\n";
  return list;
}

TEST(Schemas, every_document_that_the_programs_name_is_published_and_nothing_else) {
  const std::map<std::string, json> schemas = published();
  std::set<std::string> named = named_in_the_source();
  EXPECT_GT(named.size(), 40U);
  // A CSV (docs/EXPORT.md), and the only document that is identified by the socket it arrives at.
  EXPECT_EQ(named.erase("items/1"), 1U);
  EXPECT_EQ(named.count("control_request/1"), 0U);
  named.insert("control_request/1");
  std::set<std::string> titles;
  for (const auto& [name, schema] : schemas) {
    EXPECT_EQ(schema["title"], "slabd." + name + "/1") << "the file is named after its document";
    EXPECT_EQ(schema["$id"], "urn:slabd:" + name + ":1");
    titles.insert(name + "/1");
  }
  EXPECT_EQ(named, titles);
}

/// Adds the paths of keys without a description.
void add_unexplained(const json& schema, const std::string& path, std::vector<std::string>& list) {
  if (schema.is_array())
    for (const json& part : schema) add_unexplained(part, path, list);
  if (!schema.is_object()) return;
  for (const auto& [word, part] : schema.items()) {
    if (word != "properties") {
      add_unexplained(part, path, list);
      continue;
    }
    for (const auto& [key, value] : part.items()) {
      // A reference leads to a schema with a description; a constant needs none.
      if (!value.contains("description") && !value.contains("$ref") && !value.contains("const"))
        list.push_back(path + "/" + key);
      add_unexplained(value, path + "/" + key, list);
    }
  }
}

TEST(Schemas, every_key_says_what_it_is) {
  std::vector<std::string> unexplained;
  for (const auto& [name, schema] : schema_files()) {
    EXPECT_GT(schema["description"].get<std::string>().size(), 20U) << name;
    add_unexplained(schema, name, unexplained);
  }
  EXPECT_EQ(unexplained, std::vector<std::string>());
}

void add_references(const json& schema, std::set<std::string>& list) {
  if (schema.is_object() && schema.contains("$ref")) list.insert(schema["$ref"].get<std::string>());
  if (schema.is_structured())
    for (const json& part : schema) add_references(part, list);
}

// A reference names the $id even within its own file, because python3-jsonschema of Debian 12 resolves "#/$defs/..." in
// the wrong file as soon as one schema refers to another.
TEST(Schemas, every_reference_names_a_schema_and_every_definition_is_used) {
  std::set<std::string> references;
  std::set<std::string> documents;
  std::set<std::string> definitions;
  for (const auto& [name, schema] : schema_files()) {
    const std::string id = schema["$id"];
    add_references(schema, references);
    documents.insert(id);
    const json own = schema.value("$defs", json::object());
    for (const auto& [key, definition] : own.items()) {
      EXPECT_TRUE(definition.contains("description")) << id << " " << key;
      definitions.insert(id + "#/$defs/" + key);
    }
  }
  for (const std::string& document : documents) references.erase(document);
  EXPECT_EQ(references, definitions);
}

TEST(Schemas, every_file_is_in_the_layout_of_script_schemas) {
  EXPECT_EQ(std::system(("/usr/bin/python3 " + places::source_dir() + "/script/schemas --check").c_str()), 0);
}

TEST(Schemas, the_list_of_them_is_theirs) {
  const fs::path path = kSource / "docs/schemas/README.md";
  const std::string text = content(path);
  constexpr std::string_view kBegin = "<!-- list -->\n";
  const std::size_t begin = text.find(kBegin);
  const std::size_t end = text.find("<!-- end of list -->");
  ASSERT_NE(begin, std::string::npos);
  ASSERT_NE(end, std::string::npos);
  const std::string made = text.substr(0, begin + kBegin.size()) + list_of(published()) + text.substr(end);
  if (std::getenv("SLABD_UPDATE_DOCS") != nullptr) std::ofstream(path, std::ios::binary) << made;
  EXPECT_EQ(content(path), made) << "SLABD_UPDATE_DOCS=1 writes it again";
}

}  // namespace
}  // namespace slabd::cli
