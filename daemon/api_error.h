// Why a request of a client is refused: what becomes the gRPC status. Messages say what to do.
#pragma once

#include <string>
#include <tl/expected.hpp>

#include "core/result.h"

namespace gnathion::daemon {

enum class ApiCode {
  kInvalidArgument,
  kNotFound,
  kFailedPrecondition,
  kAlreadyExists,
  kResourceExhausted,
  kPermissionDenied,
  kUnavailable,
  kInternal
};

struct ApiError {
  ApiCode code = ApiCode::kInternal;
  std::string message;
};

template <class T>
using ApiResult = tl::expected<T, ApiError>;
using ApiStatus = tl::expected<void, ApiError>;

inline tl::unexpected<ApiError> refuse(ApiCode code, std::string message) {
  return tl::unexpected<ApiError>(ApiError{code, std::move(message)});
}
/// An expected failure as the client is told it. `input`: the code for unreadable or invalid input.
inline tl::unexpected<ApiError> refuse(const Error& error, ApiCode input = ApiCode::kFailedPrecondition) {
  const ApiCode code = error.code == ErrorCode::kUsage   ? ApiCode::kInvalidArgument
                       : error.code == ErrorCode::kInput ? input
                       : error.code == ErrorCode::kGate  ? ApiCode::kFailedPrecondition
                                                         : ApiCode::kInternal;
  return refuse(code, error.line());
}

}  // namespace gnathion::daemon
