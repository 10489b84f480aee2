// Runs a fuzz target over its seed corpus, and over small mutations of each seed, without a fuzzer.
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <vector>

#include "core/random.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size);

int main(int argc, char** argv) {
  int runs = 0;
  for (int i = 1; i < argc; ++i)
    for (const auto& entry : std::filesystem::directory_iterator(argv[i])) {
      std::ifstream in(entry.path(), std::ios::binary);
      const std::vector<char> seed((std::istreambuf_iterator<char>(in)), std::istreambuf_iterator<char>());
      gnathion::Random random(0x5eed);
      for (int mutation = 0; mutation < 300; ++mutation) {
        std::vector<std::uint8_t> bytes(seed.begin(), seed.end());
        for (int k = 0; k < mutation % 8 && !bytes.empty(); ++k)
          bytes[random.below(static_cast<std::uint32_t>(bytes.size()))] = static_cast<std::uint8_t>(random.below(256));
        if (mutation % 5 == 4) bytes.resize(random.below(static_cast<std::uint32_t>(bytes.size()) + 1));
        LLVMFuzzerTestOneInput(bytes.data(), bytes.size());
        ++runs;
      }
    }
  std::printf("%d inputs\n", runs);
  return runs > 0 ? 0 : 1;
}
