#include "tracking/session_motion.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <deque>
#include <set>
#include <thread>
#include <utility>

#include <fmt/format.h>

#include "core/bounded_queue.h"
#include "tracking/body_checks.h"

namespace gnathion {
namespace {

const char* const kCannotTrackSession = "cannot track the session";
constexpr std::size_t kPiecesWithPictures = 2;

/// What the rig's cameras delivered at one time.
struct Instant {
  HostTime capture;
  std::vector<std::optional<FrameSample>> frames;
};

/// A piece of work: consecutive instants in, rows out.
struct Chunk {
  std::vector<Instant> instants;
  std::vector<MotionRow> rows;
  std::size_t searches = 0;
  SessionEvidence evidence;

  Chunk(std::size_t cameras, bool keep_pictures) : evidence(cameras, keep_pictures) {}
};

void track_chunk(BodyTracker& tracker, Chunk* chunk) {
  tracker.reset();
  for (const Instant& instant : chunk->instants) {
    MotionRow row;
    row.capture = instant.capture;
    std::vector<const Image8*> images;
    for (const auto& frame : instant.frames) {
      images.push_back(frame ? &frame->image : nullptr);
      if (frame && row.cameras++ == 0) row.sequence = frame->header.sequence;
    }
    BodyPoses poses = tracker.next(instant.capture, images);
    chunk->evidence.add(poses, images);
    row.bow = std::move(poses.bow);
    row.head = std::move(poses.head);
    chunk->searches += poses.searched;
    chunk->rows.push_back(std::move(row));
  }
  chunk->instants = {};  // the images are not needed again
}

/// Worker threads that take chunks; results stay in the chunks, whose order is the session's.
class Workers {
 public:
  explicit Workers(std::vector<std::unique_ptr<BodyTracker>> trackers)
      : trackers_(std::move(trackers)), waiting_(1) {
    for (auto& tracker : trackers_) {
      threads_.emplace_back([this, t = tracker.get()] {
        while (const auto chunk = waiting_.pop()) track_chunk(*t, *chunk);
      });
    }
  }
  ~Workers() { finish(); }
  void submit(Chunk* chunk) { waiting_.push(chunk); }
  void finish() {
    waiting_.close();
    for (auto& thread : threads_) thread.join();
    threads_.clear();
  }

 private:
  std::vector<std::unique_ptr<BodyTracker>> trackers_;
  BoundedQueue<Chunk*> waiting_;
  std::vector<std::thread> threads_;
};

/// Puts frames of several cameras together that belong to one instant. Within a camera frames come in order.
class InstantBuilder {
 public:
  InstantBuilder(std::size_t cameras, double tolerance_s) : cameras_(cameras), tolerance_s_(tolerance_s) {}

  void add(std::size_t camera, FrameSample frame) {
    const HostTime at = frame.header.capture;
    for (Instant& instant : open_) {
      if (!instant.frames[camera] && std::abs(at.seconds_since(instant.capture)) <= tolerance_s_) {
        instant.frames[camera] = std::move(frame);
        return;
      }
    }
    Instant instant;
    instant.capture = at;
    instant.frames.resize(cameras_);
    instant.frames[camera] = std::move(frame);
    const auto later =
        std::find_if(open_.begin(), open_.end(), [&](const Instant& i) { return i.capture > at; });
    open_.insert(later, std::move(instant));
  }

  /// The next instant that is complete, or too old to become so.
  std::optional<Instant> take(bool at_end) {
    if (open_.empty()) return std::nullopt;
    const Instant& first = open_.front();
    const bool complete =
        std::all_of(first.frames.begin(), first.frames.end(), [](const auto& f) { return f.has_value(); });
    if (!complete && !at_end && open_.size() <= kOpenInstants) return std::nullopt;
    std::optional<Instant> taken(std::move(open_.front()));
    open_.pop_front();
    return taken;
  }

 private:
  static constexpr std::size_t kOpenInstants = 4;
  std::size_t cameras_;
  double tolerance_s_;
  std::deque<Instant> open_;
};

/// What became of one camera's counters. A counter that falls back, or leaps, began anew: what is lost is
/// sought within each of its runs.
class CounterBook {
 public:
  struct Lost {
    std::uint32_t sequence;
    HostTime capture;
    std::string reason;
    double period_s;  ///< of the camera there
  };

  void frame(const SampleHeader& header) {
    if (runs_.empty()) runs_.emplace_back();
    const std::vector<Frame>& frames = runs_.back().frames;
    if (!frames.empty() && (header.sequence <= frames.back().first || leaps(header.sequence, frames)))
      runs_.emplace_back();
    runs_.back().frames.emplace_back(header.sequence, header.capture);
  }
  void told(const LedgerSample& l) {
    if (l.fate == LedgerSample::Fate::kAccepted) return;
    // A line may be late, but one that lies before the run belongs to the next.
    if (runs_.empty()) runs_.emplace_back();
    const std::vector<Frame>& frames = runs_.back().frames;
    if (!frames.empty() && (l.header.sequence <= frames.front().first || leaps(l.header.sequence, frames)))
      runs_.emplace_back();
    Run& run = runs_.back();
    for (std::uint32_t i = 0; i < std::min(l.count, kMostInOneGap); ++i) {
      run.told[l.header.sequence + i] = {l.fate, l.reason, l.header.capture};
    }
  }

  /// Every counter without a frame, by gap or by word of the source, with its time from its neighbours'.
  std::vector<Lost> lost(StreamLedger* ledger) const {
    std::vector<Lost> lost;
    for (const Run& run : runs_) add_lost(run, ledger, &lost);
    return lost;
  }

 private:
  static constexpr std::uint32_t kMostInOneGap = 100000;
  using Frame = std::pair<std::uint32_t, HostTime>;
  struct Told {
    LedgerSample::Fate fate;
    std::string reason;
    HostTime capture;
  };
  struct Run {
    std::vector<Frame> frames;  ///< counters rise
    std::map<std::uint32_t, Told> told;
  };

  static bool leaps(std::uint32_t sequence, const std::vector<Frame>& frames) {
    return sequence > frames.back().first + kMostInOneGap;
  }

  static void add_lost(const Run& run, StreamLedger* ledger, std::vector<Lost>* lost) {
    std::set<std::uint32_t> arrived, gone;
    for (const Frame& f : run.frames) arrived.insert(f.first);
    for (std::size_t i = 1; i < run.frames.size(); ++i)
      for (std::uint32_t s = run.frames[i - 1].first + 1; s < run.frames[i].first; ++s) gone.insert(s);
    for (const auto& t : run.told) gone.insert(t.first);
    for (const std::uint32_t s : gone) {
      if (arrived.count(s)) continue;
      const auto known = run.told.find(s);
      const bool told = known != run.told.end();
      const bool rejected = told && known->second.fate == LedgerSample::Fate::kRejected;
      (rejected ? ledger->rejected : ledger->missing) += 1;
      const std::string why = !told || known->second.reason.empty() ? "counter gap" : known->second.reason;
      auto [capture, period_s] = time_of(run.frames, s);
      if (run.frames.empty() && told) capture = known->second.capture;
      lost->push_back({s, capture, (rejected ? "rejected: " : "missing: ") + why, period_s});
    }
  }

  /// When a lost frame was taken, and the period there.
  static std::pair<HostTime, double> time_of(const std::vector<Frame>& frames, std::uint32_t sequence) {
    if (frames.empty()) return {{}, 1.0};
    auto after = std::lower_bound(frames.begin(), frames.end(), sequence,
                                  [](const auto& f, std::uint32_t s) { return f.first < s; });
    if (frames.size() < 2) return {frames.front().second, 1.0};
    after = std::clamp(after, frames.begin() + 1, frames.end() - 1);
    const auto before = after - 1;
    const double period = static_cast<double>(after->second.ns - before->second.ns) /
                          std::max(1.0, static_cast<double>(after->first) - before->first);
    const double ahead = static_cast<double>(sequence) - static_cast<double>(before->first);
    return {HostTime{before->second.ns + static_cast<std::int64_t>(std::llround(ahead * period))},
            std::abs(period) * 1e-9};
  }

  std::vector<Run> runs_;
};

/// Rows for instants of which no camera delivered a frame.
void add_missing_rows(const std::vector<CounterBook::Lost>& lost, double same_instant_s,
                      std::vector<MotionRow>* rows) {
  std::vector<MotionRow> missing;
  const auto before = [](const MotionRow& row, HostTime t) { return row.capture < t; };
  for (const auto& l : lost) {
    // Interpolated times are less sure than captured ones: a wider tolerance.
    // But never so wide that the camera's own next frame stands for it.
    const std::int64_t slack = std::llround(1e9 * std::min(2.0 * same_instant_s, 0.4 * l.period_s));
    const auto near = std::lower_bound(rows->begin(), rows->end(), HostTime{l.capture.ns - slack}, before);
    if (near != rows->end() && near->capture.ns <= l.capture.ns + slack) continue;
    MotionRow row;
    row.sequence = l.sequence;
    row.capture = l.capture;
    row.bow.reason = row.head.reason = l.reason;
    missing.push_back(std::move(row));
  }
  rows->insert(rows->end(), std::make_move_iterator(missing.begin()), std::make_move_iterator(missing.end()));
  std::stable_sort(rows->begin(), rows->end(),
                   [](const MotionRow& a, const MotionRow& b) { return a.capture < b.capture; });
}

Status check_image(const FrameSample& frame, const CameraModel& camera) {
  const Image8& image = frame.image;
  if (image.width_px != camera.width_px || image.height_px != camera.height_px) {
    return bad_input(kCannotTrackSession, frame.header.stream,
                     fmt::format("its frames are {}×{} px, the rig says {}×{}", image.width_px,
                                 image.height_px, camera.width_px, camera.height_px));
  }
  const auto area = static_cast<std::size_t>(image.width_px) * static_cast<std::size_t>(image.height_px);
  if (image.pixels.size() != area)
    return bad_input(kCannotTrackSession, frame.header.stream, "a frame has not all its pixels");
  return {};
}

/// One pass over a source, from samples to rows.
class SessionTracker {
 public:
  SessionTracker(const Rig& rig, const TrackOptions& options)
      : rig_(rig), options_(options), builder_(rig.cameras.size(), options.same_instant_s) {
    for (std::size_t c = 0; c < rig.cameras.size(); ++c) camera_of_[rig.cameras[c].name] = c;
    books_.resize(rig.cameras.size());
  }

  Result<SessionMotion> run(Source& source, Progress& progress) {
    GNATHION_CHECK_OK(start_workers());
    GNATHION_CHECK_OK(pull_all(source, progress));
    submit_instants(true);
    workers_->finish();
    if (frames_ == 0)
      return bad_input(kCannotTrackSession, "recording", "no frame of " + camera_names() + streams_seen());
    return collect();
  }

 private:
  Status start_workers() {
    std::vector<std::unique_ptr<BodyTracker>> trackers;
    for (int i = 0; i < std::max(1, options_.threads); ++i) {
      GNATHION_TRY(auto tracker, BodyTracker::create(rig_, options_.tracker));
      trackers.push_back(std::move(tracker));
    }
    workers_ = std::make_unique<Workers>(std::move(trackers));
    return {};
  }

  Status pull_all(Source& source, Progress& progress) {
    bool first = true;
    while (true) {
      auto pulled = source.next();
      if (!pulled) return in_context(kCannotTrackSession, pulled.error());
      if (!*pulled) return {};
      if (std::exchange(first, false)) session_.start = header_of(**pulled).capture;
      GNATHION_CHECK_OK(take(std::move(**pulled)));
      if (options_.fraction_read) progress.update(options_.fraction_read());
    }
  }

  Status take(Sample sample) {
    if (auto* event = std::get_if<EventSample>(&sample)) {
      session_.events.push_back(std::move(*event));
      return {};
    }
    const std::string stream = header_of(sample).stream;
    const auto camera = camera_of_.find(stream);
    if (auto* told = std::get_if<LedgerSample>(&sample)) {
      if (camera != camera_of_.end()) books_[camera->second].told(*told);
      return {};
    }
    if (!std::holds_alternative<FrameSample>(sample)) return {};  // other instruments' samples
    FrameSample& frame = std::get<FrameSample>(sample);
    if (camera == camera_of_.end()) {
      ++session_.ledger[stream].ignored;
      return {};
    }
    GNATHION_CHECK_OK(check_image(frame, rig_.cameras[camera->second].model));
    ++session_.ledger[stream].frames;
    ++frames_;
    books_[camera->second].frame(frame.header);
    builder_.add(camera->second, std::move(frame));
    submit_instants(false);
    return {};
  }

  void submit_instants(bool at_end) {
    while (auto instant = builder_.take(at_end)) {
      if (chunks_.empty() || filled_ == static_cast<std::size_t>(std::max(1, options_.chunk_frames)))
        next_chunk();
      chunks_.back().instants.push_back(std::move(*instant));
      ++filled_;
    }
    if (at_end && !chunks_.empty()) workers_->submit(&chunks_.back());
  }

  void next_chunk() {
    if (!chunks_.empty()) workers_->submit(&chunks_.back());
    chunks_.emplace_back(rig_.cameras.size(), chunks_.size() < kPiecesWithPictures);
    filled_ = 0;
  }

  Result<SessionMotion> collect() {
    SessionEvidence evidence(rig_.cameras.size());
    for (Chunk& chunk : chunks_) {
      evidence.merge(chunk.evidence);
      std::move(chunk.rows.begin(), chunk.rows.end(), std::back_inserter(session_.rows));
      session_.full_searches += chunk.searches;
    }
    std::stable_sort(session_.rows.begin(), session_.rows.end(),
                     [](const MotionRow& a, const MotionRow& b) { return a.capture < b.capture; });
    std::size_t valid = 0;
    std::map<std::string, int> reasons;
    for (const MotionRow& row : session_.rows) {
      valid += row.valid();
      ++reasons[row.reason()];
    }
    const auto usual = std::max_element(reasons.begin(), reasons.end(),
                                        [](const auto& a, const auto& b) { return a.second < b.second; });
    GNATHION_CHECK_OK(evidence.refusal(rig_, valid, usual->first));
    session_.warnings = evidence.warnings(rig_);
    for (std::size_t c = 0; c < books_.size(); ++c) {
      const auto lost = books_[c].lost(&session_.ledger[rig_.cameras[c].name]);
      add_missing_rows(lost, options_.same_instant_s, &session_.rows);
    }
    std::stable_sort(
        session_.events.begin(), session_.events.end(),
        [](const EventSample& a, const EventSample& b) { return a.header.capture < b.header.capture; });
    return std::move(session_);
  }

  std::string camera_names() const {
    std::string names;
    for (const RigCamera& c : rig_.cameras) names += (names.empty() ? "" : ", ") + c.name;
    return names;
  }
  std::string streams_seen() const {
    std::string names;
    for (const auto& s : session_.ledger) names += (names.empty() ? "; it holds " : ", ") + s.first;
    return names;
  }

  const Rig& rig_;
  const TrackOptions& options_;
  InstantBuilder builder_;
  std::map<std::string, std::size_t> camera_of_;
  std::vector<CounterBook> books_;
  std::deque<Chunk> chunks_;  // stable addresses: workers hold pointers
  std::size_t filled_ = 0, frames_ = 0;
  SessionMotion session_;
  std::unique_ptr<Workers> workers_;  // last: its threads end before what they use
};

}  // namespace

std::string MotionRow::reason() const {
  if (valid()) return {};
  if (bow.reason == head.reason) return bow.reason;
  std::string text;
  if (!bow.valid) text = "bow: " + bow.reason;
  if (!head.valid) text += (text.empty() ? "" : "; ") + ("head: " + head.reason);
  return text;
}

Transform<HeadFrame, Bow> MotionRow::head_from_bow() const {
  return Transform<HeadFrame, Bow>(head.camera_from_body.inverse() * bow.camera_from_body);
}

Matrix6 MotionRow::head_from_bow_covariance() const {
  // exp(ξ) = H⁻¹·exp(−ξ_h)·exp(ξ_b)·M·(H⁻¹M)⁻¹, so that ξ = Ad_{H⁻¹}(ξ_b − ξ_h).
  const Matrix6 ad = adjoint(head.camera_from_body.inverse());
  return ad * (bow.covariance + head.covariance) * ad.transpose();
}

Result<SessionMotion> track_session(Source& source, const Rig& rig, const TrackOptions& options,
                                    Progress& progress) {
  return SessionTracker(rig, options).run(source, progress);
}

}  // namespace gnathion
