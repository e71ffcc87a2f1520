// SPDX-License-Identifier: Apache-2.0
//
// The README's pictures are pages that this report makes from the slab of script/demo, whose database is stored next to
// them. script/pictures makes all of them again.
#include "tests/cli/slabctl_process.h"
#include "tests/places/places.h"

namespace slabd::cli {
namespace {

class Pictures : public Slabctl {};

TEST_F(Pictures, are_what_the_report_draws_now) {
  const std::string folder = places::source_dir() + "/docs/pictures/";
  // A reader of the database writes nothing, but it may need to write next to it.
  fs::copy_file(folder + "demo.db", file("demo.db"));
  for (const auto& [page, picture] : {std::pair{1, "report-slab.png"}, std::pair{2, "report-blocks.png"}}) {
    const Ended ended = run("report BAD-2 --db " + file("demo.db") + " --page " + std::to_string(page) +
                            " --dpi 80 --out " + file(picture));
    ASSERT_EQ(ended.status, 0) << ended.err;
    EXPECT_TRUE(content(file(picture)) == content(folder + picture)) << picture << ": run script/pictures";
  }
}

}  // namespace
}  // namespace slabd::cli
