// Expected failures: a value, or an error that says what, where and why, and gains context on its way up.
#pragma once

#include <string>
#include <tl/expected.hpp>
#include <utility>

namespace gnathion {

/// What kind of failure; the command line maps it to its exit code (exit_code()).
enum class ErrorCode {
  kInternal,  ///< anything else: exit 1
  kUsage,     ///< wrong usage: exit 2
  kGate,      ///< valid input whose result fails a gate: exit 3
  kInput,     ///< unreadable or invalid input: exit 4
};

/// Printed as one line: "gnathion: WHAT: WHERE: WHY".
struct Error {
  ErrorCode code = ErrorCode::kInternal;
  std::string what;   ///< what was attempted: "cannot read mesh"
  std::string where;  ///< the file, stream, gate: "scans/maxilla.stl"
  std::string why;    ///< the reason: "truncated: 1000 triangles announced, 998 present"

  std::string line() const;  ///< "WHAT: WHERE: WHY", newlines removed
};

int exit_code(ErrorCode code);

template <class T>
using Result = tl::expected<T, Error>;
using Status = tl::expected<void, Error>;

inline tl::unexpected<Error> fail(ErrorCode code, std::string what, std::string where, std::string why) {
  return tl::unexpected<Error>(Error{code, std::move(what), std::move(where), std::move(why)});
}
inline tl::unexpected<Error> bad_input(std::string what, std::string where, std::string why) {
  return fail(ErrorCode::kInput, std::move(what), std::move(where), std::move(why));
}
/// Passes an error up, with the caller's own `what` before it.
tl::unexpected<Error> in_context(const std::string& what, Error error);

}  // namespace gnathion

/// Returns the error of a Result from the enclosing function, or binds its value to `lhs`.
#define GNATHION_CONCAT_(a, b) a##b
#define GNATHION_CONCAT(a, b) GNATHION_CONCAT_(a, b)
#define GNATHION_TRY_(tmp, lhs, expression)                                   \
  auto tmp = (expression);                                                    \
  if (!tmp) return tl::unexpected<::gnathion::Error>(std::move(tmp.error())); \
  lhs = std::move(*tmp)
#define GNATHION_TRY(lhs, expression) GNATHION_TRY_(GNATHION_CONCAT(gnathion_try_, __LINE__), lhs, expression)
/// The same for a Status.
#define GNATHION_CHECK_OK(expression)                                                                   \
  do {                                                                                                  \
    auto gnathion_status = (expression);                                                                \
    if (!gnathion_status) return tl::unexpected<::gnathion::Error>(std::move(gnathion_status.error())); \
  } while (false)
