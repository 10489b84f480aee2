// Every key of the example: read, and either taken up by a reload or named as waiting for a restart.
#include "daemon/config.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <fstream>
#include <set>
#include <sstream>

namespace gnathion::daemon {
namespace {

namespace fs = std::filesystem;

/// The example with one key's value replaced; keys that are commented out are put in.
std::string example_with(const std::string& key, const std::string& value) {
  std::ifstream in("packaging/gnathiond.toml");
  std::stringstream out;
  for (std::string line; std::getline(in, line);) {
    const std::string bare = line.rfind("# ", 0) == 0 ? line.substr(2) : line;
    out << (bare.rfind(key + " = ", 0) == 0 ? key + " = " + value : line) << "\n";
  }
  return out.str();
}

DaemonConfig read(const std::string& text) {
  const fs::path file = fs::temp_directory_path() / ("gnathiond_" + std::to_string(::getpid()) + ".toml");
  std::ofstream(file) << text;
  const auto config = read_daemon_config(file);
  EXPECT_TRUE(config) << config.error().line();
  fs::remove(file);
  return config.value_or(DaemonConfig{});
}

TEST(DaemonConfigFile, AReloadNamesEverySettingThatWaits) {
  const std::set<std::string> at_once = {"log_level", "devices",   "rig",
                                         "chain",     "queue_mib", "holder_grace_s"};
  const DaemonConfig running = read(example_with("", ""));
  EXPECT_TRUE(needs_restart(running, running).empty());
  std::ifstream in("packaging/gnathiond.toml");
  int keys = 0;
  for (std::string line; std::getline(in, line);) {
    const std::string bare = line.rfind("# ", 0) == 0 ? line.substr(2) : line;
    const std::size_t equals = bare.find(" = ");
    if (equals == std::string::npos || bare.find(' ') != equals) continue;
    const std::string key = bare.substr(0, equals);
    const char first = bare[equals + 3];
    const std::string other = key == "log_level" ? "\"debug\""
                              : first == '"'     ? "\"/other\""
                              : first == 't'     ? "false"
                                                 : "19";
    const std::string wanted = key == "message_kib" ? "100" : other;
    const auto lines = needs_restart(running, read(example_with(key, wanted)));
    if (at_once.count(key)) {
      EXPECT_TRUE(lines.empty()) << key;
    } else {
      ASSERT_EQ(lines.size(), 1u) << key;
      EXPECT_NE(lines[0].find("'" + key + "'"), std::string::npos) << lines[0];
    }
    ++keys;
  }
  EXPECT_GE(keys, 24);
}

}  // namespace
}  // namespace gnathion::daemon
