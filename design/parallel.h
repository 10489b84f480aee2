// Parallel loops of the design. Private to design/: only .cc files include it.
#pragma once

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

namespace gnathion {

/// Calls body(i) for i in [0, count), each exactly once, on any thread. Bodies write to their own slots only,
/// so that results do not depend on the schedule.
template <class Index, class Body>
void parallel_each(Index count, const Body& body) {
  tbb::parallel_for(tbb::blocked_range<Index>(Index(0), count), [&](const tbb::blocked_range<Index>& range) {
    for (Index i = range.begin(); i != range.end(); ++i) body(i);
  });
}

}  // namespace gnathion
