// The film of the virtual patient: jaw and head in motion, seen by the rig's cameras, as a Source.
#pragma once

#include <cstdint>
#include <deque>
#include <limits>
#include <memory>
#include <vector>

#include "core/camera_model.h"
#include "core/mesh.h"
#include "core/source.h"
#include "core/time.h"
#include "core/transform.h"
#include "phantom/jaw_motion.h"

namespace gnathion {

/// All that the film needs to know of a patient.
struct FilmScene {
  Rig rig;                                 ///< one or two cameras, bow and head frame with their tags
  TriangleMesh bow_surface, head_surface;  ///< in their bodies' frames; may be empty
  Transform<Bow, Dental> bow_from_dental;  ///< T_D: the bow on the teeth, jaw in MI
  Transform<HeadFrame, Dental> head_from_dental;
  Transform<Camera, Dental> camera_from_dental_at_rest;
  Motion<Dental> therapeutic;                                   ///< T_th
  Vector3 condyle_left_mm, condyle_right_mm, incisal_point_mm;  ///< dental frame
};

struct FilmOptions {
  std::uint64_t seed = 1;
  double rate_hz = 60;
  double exposure_s = 0.004;
  double noise_sigma = 2;  ///< grey levels
  double blur_sigma_px = 0.7;
  double duration_s = 16;        ///< of the whole sequence; the film ends with it
  bool border_movements = true;  ///< otherwise rest, MI and TP only (a short film)
  double head_motion = 1;        ///< 0: the head stands still
  bool clutter = true;
  double drop_fraction = 0;  ///< of frames lost between camera and host: their counters are missing
  int prefetch_frames = 16;  ///< rendered ahead in parallel; the result does not depend on it
};

/// Every true pose at one time.
struct FilmTruth {
  HostTime capture;
  Transform<Camera, Bow> camera_from_bow;
  Transform<Camera, HeadFrame> camera_from_head;
  Transform<Camera, Dental> camera_from_dental;
  Motion<Dental> mandible;  ///< from MI, tremor included
};

/// Streams "camera_0" (the rig's names) and "pedal" in order of capture time; host time 0 at the start.
class PhantomFilm : public Source {
 public:
  PhantomFilm(FilmScene scene, FilmOptions options);
  ~PhantomFilm() override;

  /// Fails for a rig whose tags cannot be drawn.
  Result<std::optional<Sample>> next() override;

  FilmTruth truth_at(HostTime time) const;
  const JawSequence& jaw() const { return jaw_; }
  const FilmScene& scene() const { return scene_; }
  /// Frames a camera takes, dropped ones included.
  std::uint32_t frames_per_camera() const { return frame_count_; }
  HostTime capture_time(std::uint32_t frame) const;

 private:
  struct Renderers;
  Status prepare_renderers();
  FilmTruth truth_at_seconds(double time_s) const;
  bool dropped(std::size_t camera, std::uint32_t frame) const;
  SampleHeader frame_header(std::size_t camera, std::uint32_t frame) const;
  Image8 expose(std::size_t camera, std::uint32_t frame) const;
  void prefetch();
  std::optional<EventSample> event_due(HostTime before);

  FilmScene scene_;
  FilmOptions options_;
  JawSequence jaw_;
  HeadMotion head_;
  std::vector<JawMark> marks_;
  std::uint32_t frame_count_;
  std::unique_ptr<Renderers> renderers_;
  std::uint32_t next_frame_ = 0;  ///< first frame not yet rendered
  std::size_t next_mark_ = 0;
  std::deque<FrameSample> ready_;
};

}  // namespace gnathion
