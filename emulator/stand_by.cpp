// SPDX-License-Identifier: Apache-2.0
#include "emulator/stand_by.h"

#include <chrono>
#include <istream>
#include <ostream>
#include <sstream>
#include <string>
#include <thread>

namespace slabd::simulate {
namespace {

std::string obey(const StandBy& line, std::size_t& slab, const std::string& order) {
  std::istringstream words(order);
  std::string verb;
  int number = 0;
  if (!(words >> verb >> number)) return "error: expected \"slab N\" or \"station K\"";
  if (verb == "slab") {
    if (number < 1 || static_cast<std::size_t>(number) > line.slabs.size())
      return "error: slab 1.." + std::to_string(line.slabs.size());
    slab = static_cast<std::size_t>(number) - 1;
    line.scanner.look_at(line.recipe, line.slabs[slab], line.cell);
    return "slab " + std::to_string(number);
  }
  const int stations = line.slabs[slab].stations;
  if (verb != "station" || number < 1 || number > stations)
    return "error: station 1.." + std::to_string(stations) + ", or slab N";
  line.robot.move_to(line.slabs[slab].at(number).T_base_flange_reported);
  line.scanner.stand_over(number, number < stations ? number + 1 : 0);
  while (!line.robot.standing()) std::this_thread::sleep_for(std::chrono::milliseconds(2));
  return "standing " + std::to_string(number);
}

}  // namespace

void stand_by(const StandBy& line, std::istream& in, std::ostream& out, const std::atomic<bool>& stop) {
  std::size_t slab = 0;
  line.scanner.look_at(line.recipe, line.slabs[slab], line.cell);
  std::string order;
  while (!stop && std::getline(in, order)) out << obey(line, slab, order) << std::endl;
}

}  // namespace slabd::simulate
