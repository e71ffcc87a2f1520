// SPDX-License-Identifier: Apache-2.0
#include "cli/study/same_part.h"

#include <fmt/core.h>

#include <algorithm>
#include <filesystem>
#include <regex>

#include "cli/exit.h"
#include "report/words.h"

namespace slabd::cli::study {
namespace {

/// More of them say nothing new.
constexpr std::size_t kSentencesShown = 6;

template <typename T>
void add_once(std::vector<T>& list, const T& value) {
  if (std::find(list.begin(), list.end(), value) == list.end()) list.push_back(value);
}

/// "'A', 'B', 'C' and 15 more"
std::string listed(const std::vector<std::string>& names) {
  std::string text;
  for (std::size_t i = 0; i < std::min(names.size(), kSentencesShown); ++i)
    text += fmt::format("{}'{}'", i == 0 ? "" : ", ", names[i]);
  if (names.size() > kSentencesShown) text += fmt::format(" and {} more", names.size() - kSentencesShown);
  return text;
}

std::vector<std::string> texts_of(const std::vector<int>& numbers) {
  std::vector<std::string> texts;
  for (const int number : numbers) texts.push_back(std::to_string(number));
  return texts;
}

}  // namespace

std::optional<int> block_in_name(const std::string& path) {
  const std::string stem = std::filesystem::path(path).stem().string();
  static const std::regex kSpool("^([0-9]{2})-[0-9]{1,3}$");
  static const std::regex kWord("(^|[^a-z])(block|station|seat)[ _-]?([0-9]{1,2})([^0-9]|$)", std::regex::icase);
  std::smatch found;
  int block = 0;
  if (std::regex_search(stem, found, kSpool)) block = std::stoi(found[1]);
  if (block == 0 && std::regex_search(stem, found, kWord)) block = std::stoi(found[3]);
  return block >= 1 && block <= static_cast<int>(limits::kStationsMax) ? std::optional(block) : std::nullopt;
}

std::vector<std::string> StudyNotes::sentences() const {
  std::vector<std::string> list;
  if (emulated != 0) list.push_back(report::emulation_notice(emulated, report::Language::en));
  if (!differs.empty())
    list.push_back(fmt::format("taken for one part because of --same-part \"{}\", although:", same_part));
  list.insert(list.end(), differs.begin(), differs.end());
  return list;
}

void write_notes(Json& json, const StudyNotes& notes) {
  json.key("same_part");
  if (notes.differs.empty()) {
    json.null();
  } else {
    json.begin_object().field("why", notes.same_part).field("differs", notes.differs).end_object();
  }
  write_emulation(json, notes.emulated);
}

void SamePart::add_slab(const std::string& part, const SlabHeader& slab) {
  Part& known = parts_[part];
  add_once(known.ids, std::string(slab.slab_id.view()));
  add_once(known.types, static_cast<int>(slab.slab_type));
  emulated_ |= slab.emulated;
  any_real_ = any_real_ || slab.emulated == 0;
}

void SamePart::add_scan(const std::string& part, const std::string& path, int block, const ScanShape& shape) {
  add_once(parts_[part].blocks, block);
  const unsigned bits = shape.emulated ? kEmulatedScan : 0U;
  emulated_ |= bits;
  any_real_ = any_real_ || bits == 0;
  const std::optional<int> named = block_in_name(path);
  const int stated = shape.emulated_block != 0 ? shape.emulated_block : named.value_or(0);
  if (stated != 0 && stated != block)
    wrong_blocks_.push_back(fmt::format("{} is of block {} by its {}, and is measured as block {}", path, stated,
                                        shape.emulated_block != 0 ? "comment" : "name", block));
}

StudyNotes SamePart::settle(const std::string& why) const {
  StudyNotes notes;
  notes.same_part = why;
  notes.emulated = static_cast<std::uint8_t>(emulated_);
  for (const auto& [name, part] : parts_) {
    const std::string what = name.empty() ? "one part" : fmt::format("part '{}'", name);
    if (part.ids.size() > 1)
      notes.differs.push_back(
          fmt::format("{} slabs of different ids are taken for {}: {}", part.ids.size(), what, listed(part.ids)));
    if (part.types.size() > 1)
      notes.differs.push_back(
          fmt::format("slabs of different types are taken for {}: {}", what, listed(texts_of(part.types))));
    if (part.blocks.size() > 1)
      notes.differs.push_back(
          fmt::format("scans of different blocks are taken for {}: {}", what, listed(texts_of(part.blocks))));
  }
  for (std::size_t i = 0; i < std::min(wrong_blocks_.size(), kSentencesShown); ++i)
    notes.differs.push_back(wrong_blocks_[i]);
  if (wrong_blocks_.size() > kSentencesShown)
    notes.differs.push_back(fmt::format("and {} more scans of other blocks", wrong_blocks_.size() - kSentencesShown));
  if (emulated_ != 0 && any_real_) notes.differs.emplace_back("emulated measurements are mixed with real ones");
  if (notes.differs.empty() || !why.empty()) return notes;
  for (const std::string& sentence : notes.differs) complain(sentence);
  stop(kBadInput,
       "a study is about one part measured again; if these are one all the same, say why: --same-part \"WHY\", which "
       "is printed with the study");
}

}  // namespace slabd::cli::study
