#include "cli/command.h"

int main(int argc, char** argv) {
  return gnathion::run_command_line(argc, argv);
}
