#include "core/result.h"

#include <algorithm>

namespace gnathion {

std::string Error::line() const {
  std::string text = what + ": " + where + ": " + why;
  std::replace(text.begin(), text.end(), '\n', ' ');
  return text;
}

int exit_code(ErrorCode code) {
  switch (code) {
    case ErrorCode::kUsage:
      return 2;
    case ErrorCode::kGate:
      return 3;
    case ErrorCode::kInput:
      return 4;
    case ErrorCode::kInternal:
      break;
  }
  return 1;
}

tl::unexpected<Error> in_context(const std::string& what, Error error) {
  error.what = what + ": " + error.what;
  return tl::unexpected<Error>(std::move(error));
}

}  // namespace gnathion
