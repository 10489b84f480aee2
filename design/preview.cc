#include "design/preview.h"

#include <cstring>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

#include "core/time.h"
#include "design/extraction.h"
#include "design/preparation.h"
#include "design/splint_field.h"

namespace gnathion {
namespace {

constexpr PreparationGrid kGrid{0.6, 2.4};

/// A number that tells meshes apart (FNV-1a over the bytes, eight at a time).
std::uint64_t fingerprint(const TriangleMesh& mesh, std::uint64_t seed) {
  constexpr std::uint64_t kPrime = 1099511628211ULL;
  std::uint64_t hash = seed ^ 14695981039346656037ULL;
  const auto mix = [&](std::string_view bytes) {
    while (bytes.size() >= 8) {
      std::uint64_t word = 0;
      std::memcpy(&word, bytes.data(), 8);
      hash = (hash ^ word) * kPrime;
      hash ^= hash >> 29;
      bytes.remove_prefix(8);
    }
    for (const char c : bytes) hash = (hash ^ static_cast<unsigned char>(c)) * kPrime;
  };
  mix({reinterpret_cast<const char*>(mesh.vertices_mm.data()), mesh.vertices_mm.size() * sizeof(Vector3)});
  mix({reinterpret_cast<const char*>(mesh.triangles.data()), mesh.triangles.size() * sizeof(Triangle)});
  return hash;
}

/// What the supporting arch's stage is made of.
struct SupportKey {
  std::uint64_t maxilla = 0, mandible = 0, occlusal_surface = 0;
  Arch arch = Arch::kMaxilla;
  double search_deg = 0, left_deg = 0, anterior_deg = 0, depth_mm = 0, first_tooth = 0, last_tooth = 0;
  std::string marks;  // teeth corrected by hand, and margins: the insertion hangs on them

  SupportKey(const SplintInputs& in, const SplintParameters& p)
      : maxilla(fingerprint(in.maxilla, 1)),
        mandible(fingerprint(in.mandible_mi, 2)),
        occlusal_surface(in.occlusal_surface ? fingerprint(*in.occlusal_surface, 3) : 0),
        arch(in.arch),
        search_deg(p.insertion_search_deg),
        left_deg(p.insertion_left_deg),
        anterior_deg(p.insertion_anterior_deg),
        depth_mm(p.depth_mm),
        first_tooth(p.first_tooth),
        last_tooth(p.last_tooth) {
    SplintEdits drawn;
    drawn.teeth = in.edits.teeth;
    drawn.margins = in.edits.margins;
    marks = marks_toml(drawn);
  }
  bool operator==(const SupportKey& b) const {
    return maxilla == b.maxilla && mandible == b.mandible && occlusal_surface == b.occlusal_surface &&
           arch == b.arch && search_deg == b.search_deg && left_deg == b.left_deg &&
           anterior_deg == b.anterior_deg && depth_mm == b.depth_mm && first_tooth == b.first_tooth &&
           last_tooth == b.last_tooth && marks == b.marks;
  }
};

bool same_shape(const GridShape& a, const GridShape& b) {
  return a.origin_mm == b.origin_mm && a.spacing_mm == b.spacing_mm && a.nodes == b.nodes;
}

/// Voxels and thinnest wall that go together, whatever the design has.
SplintParameters for_preview(SplintParameters p) {
  p.voxel_mm = SplintPreviewer::kVoxelMm;
  p.aperture_limit_mm = std::max(p.aperture_limit_mm, 2.0 * p.voxel_mm);
  p.wall_mm = std::max(p.wall_mm, p.aperture_limit_mm);
  return p;
}

}  // namespace

struct SplintPreviewer::State {
  std::optional<SupportKey> support;
  std::optional<Preparation> preparation;
  Rigid3 sampled_tp_from_mi;  ///< of `jaws`
  GridShape sampled;
  JawDistances jaws;

  Status prepare_stage(const SplintInputs& inputs, const SplintParameters& p);
  void sample_stage();
};

Status SplintPreviewer::State::prepare_stage(const SplintInputs& inputs, const SplintParameters& p) {
  const SupportKey key(inputs, p);
  const bool same = preparation && support == key;
  std::optional<Preparation> last = std::exchange(preparation, std::nullopt);
  if (same) {
    GNATHION_TRY(preparation, prepared_again(std::move(*last), inputs, p, kGrid));
  } else {
    sampled = {};  // of other jaws
    GNATHION_TRY(preparation, prepare(inputs, p, kGrid));
  }
  preparation->label_texts.clear();  // too fine for these voxels, and its place takes time to find
  support = key;
  return {};
}

void SplintPreviewer::State::sample_stage() {
  const Preparation& now = *preparation;
  const bool same_box = same_shape(sampled, now.coarse);
  if (same_box && sampled_tp_from_mi.matrix() == now.tp_from_mi.matrix()) return;
  jaws = same_box ? resampled_opposing(now, std::move(jaws)) : sampled_jaws(now);
  sampled = now.coarse;
  sampled_tp_from_mi = now.tp_from_mi;
}

SplintPreviewer::SplintPreviewer() : state_(std::make_unique<State>()) {}
SplintPreviewer::~SplintPreviewer() = default;

Result<SplintPreview> SplintPreviewer::build(const SplintInputs& inputs, const SplintParameters& given) {
  const SplintParameters p = for_preview(given);
  GNATHION_CHECK_OK(check_parameters(p));
  SplintPreview preview;
  Stopwatch watch;
  const auto done = [&](const char* stage) {
    preview.timing_s.emplace_back(stage, watch.seconds());
    watch.restart();
  };
  GNATHION_CHECK_OK(state_->prepare_stage(inputs, p));
  done("preparation");
  state_->sample_stage();
  done("distances");
  const SplintField field(*state_->preparation, p, state_->jaws);
  done("shells and stamp");
  LargestPiece pieces = largest_piece(extracted_splint(field), pieces_of(p));
  done("extraction");
  if (pieces.mesh.empty())
    return fail(ErrorCode::kGate, "cannot design", "splint", "nothing remains between the jaws");
  const Preparation& prep = *state_->preparation;
  preview.splint = transformed(prep.design_from_dental.inverse(), pieces.mesh);
  preview.arch = prep.arch;
  preview.insertion = prep.insertion;
  preview.warnings = prep.warnings;
  return preview;
}

}  // namespace gnathion
