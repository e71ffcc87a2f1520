// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <regex>
#include <string>

namespace slabd::cli {

/// Expects a Chinese text whose only letters are names, commands, codes, units and quotations.
inline void expect_chinese(const std::string& text) {
  static const std::regex kAllowed(
      "“[^”]*”|\"[^\"\n]*\"|`[^`\n]*`"  // quotations and ids
      "|\\w+://[\\d.:]+\\?ttl=\\d"      // addresses and paths
      "|[\\w.~-]*/[\\w./*:~-]*"
      "|\\[\\w+\\]( \\w+( = \\w+)?)?|\\[Service\\]|\\w+ = \\w+"  // keys of the configuration
      "|\\w*_\\w*|\\w+=\\w+"                                     // keys, registers and enumerators
      "|--[a-z-]+( (ball|artefact)\\b)?|[A-Z][A-Z0-9-]+"         // options, arguments and abbreviations
      "|slabctl( [a-z-]+)*|slabd|journalctl( -[ku]( slabd)?)?|systemctl( [a-z]+)*( slabd)?|timedatectl \\S+ true"
      "|ip (address|route)( add| get [\\d.]+)?|df -i|findmnt -T|ss -ltnp 'sport|ulimit -f unlimited|cpupower [-a-z ]+"
      "|chown \\S+|chgrp -R|chmod \\S+|usermod -aG dialout|ls -l|echo madvise >|Max [a-z ]+"
      "|操作者 [\\w.-]+|会话 [\\w.-]+|在 [\\w.-]+ 上|经由 [\\w.-]+"  // names of people and interfaces
      "|\\w+ \\d+ 次|\\w{2}-[0-9a-f]{6,}|\\b[0-9a-f]{8,}\\b|commissioning-\\w+|[\\w-]+\\.(toml|ply|db|txt|sock|md)"
      "|\\b(mm|deg|ms|s|kB|MB|GB|ppm|root|flags|bits?|inode|systemd|chrony|abcd|cdab|slabd|Modbus)\\b"
      "|\\b[a-zA-Z]\\b|\\b\\d+x\\b|\\bq[wxyz]\\b");
  const std::string rest = std::regex_replace(text, kAllowed, " ");
  static const std::regex kLetters("[A-Za-z]{2,}");
  std::smatch left;
  EXPECT_FALSE(std::regex_search(rest, left, kLetters)) << "'" << left.str() << "' in:\n" << text;
  EXPECT_TRUE(std::any_of(text.begin(), text.end(), [](char c) { return static_cast<unsigned char>(c) >= 0xE4; }))
      << text;
}

}  // namespace slabd::cli
