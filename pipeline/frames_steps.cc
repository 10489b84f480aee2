#include "pipeline/frames_steps.h"

#include <fmt/format.h>

#include <chrono>
#include <nlohmann/json.hpp>
#include <sstream>

#include "calibration/frames_graph_json.h"
#include "core/file.h"
#include "core/mesh_io.h"
#include "core/transform_io.h"
#include "core/utc.h"
#include "pipeline/toml_file.h"
#include "registration/align.h"

namespace gnathion {
namespace fs = std::filesystem;
namespace {

using nlohmann::json;
constexpr const char* kWhat = "cannot read case";

/// When a file was written last: the nearest to a scan's date that a file tells.
std::string date_of(const fs::path& path) {
  std::error_code ec;
  const auto time = fs::last_write_time(path, ec);
  if (ec) return "";
  const auto since_epoch = std::chrono::file_clock::to_sys(time).time_since_epoch();
  return utc_text(HostTime{std::chrono::duration_cast<std::chrono::nanoseconds>(since_epoch).count()});
}

FrameEdge edge_of(const char* to, const char* from, const Rigid3& value, const Matrix6& covariance,
                  const std::string& date, const std::string& source, const char* estimate) {
  return {to, from, value, covariance, date, source, estimate, false};
}

std::vector<Vector3> teeth_of(const TriangleMesh& mandible) {
  constexpr std::size_t kPoints = 200;
  std::vector<Vector3> out;
  const std::size_t step = mandible.vertices_mm.size() / kPoints + 1;
  for (std::size_t v = 0; v < mandible.vertices_mm.size(); v += step) out.push_back(mandible.vertices_mm[v]);
  return out;
}

Status add_chain(const CaseFile& files, const Chain& chain, FramesGraph& graph) {
  const std::string clutch = date_of(files.mandible_clutch);
  const ChainPose& t_d = chain.bow_from_dental;
  GNATHION_CHECK_OK(graph.add(edge_of("bow", "dental", t_d.value, t_d.covariance, clutch,
                                      "T_D: clutch scan on lower arch and bow", "T_D")));
  GNATHION_CHECK_OK(graph.add(edge_of("bow_tp", "mandible_tp", t_d.value, t_d.covariance, clutch,
                                      "T_D again: the clutch sits on the teeth in TP as in MI", "T_D")));
  if (!chain.has_faces) return {};
  const ChainPose &t_f = chain.bow_from_face, &tp = chain.bow_from_face_tp,
                  &head = chain.face_mi_from_face_tp;
  const std::string mi_date = date_of(files.face_mi), tp_date = date_of(files.face_tp);
  GNATHION_CHECK_OK(graph.add(edge_of("bow", "face_mi", t_f.value, t_f.covariance, mi_date,
                                      "T_F: bow in the face scan in MI", "T_F")));
  GNATHION_CHECK_OK(graph.add(edge_of("bow_tp", "face_tp", tp.value, tp.covariance, tp_date,
                                      "bow in the face scan in TP", "bow in face TP")));
  GNATHION_CHECK_OK(graph.add(edge_of("face_mi", "face_tp", head.value, head.covariance, tp_date,
                                      "head in the two face scans", "head between faces")));
  const char* const names[kChainStates] = {"T_D", "T_F", "bow in face TP", "head between faces"};
  for (int a = 0; a < kChainStates; ++a)
    for (int b = a + 1; b < kChainStates; ++b)
      graph.set_cross_covariance(names[a], names[b], chain.joint.block<6, 6>(6 * a, 6 * b));
  return {};
}

Status add_camera(const CaseFile& files, const CameraRoute& camera, FramesGraph& graph) {
  const JawPositions& p = camera.positions;
  const std::string date = date_of(files.recording);
  GNATHION_CHECK_OK(
      graph.add(edge_of("head_frame", "bow", p.head_from_bow_mi.value.rigid, p.head_from_bow_mi.covariance,
                        date, "camera: bow in the head frame at MI", "K0")));
  GNATHION_CHECK_OK(
      graph.add(edge_of("head_frame", "bow_tp", p.head_from_bow_tp.value.rigid, p.head_from_bow_tp.covariance,
                        date, "camera: bow in the head frame at TP", "K1")));
  FrameEdge view = edge_of("camera", "head_frame", p.at_mi.f_from_head.rigid, Matrix6::Zero(), date,
                           "camera: head frame, mean over MI", "H0");
  view.covariance.reset();
  return graph.add(std::move(view));
}

Status add_intraoral_tp(const CaseFile& files, FramesGraph& graph, std::vector<std::string>& notes) {
  if (files.maxilla_tp.empty() || files.mandible_tp.empty()) return {};
  GNATHION_TRY(const TriangleMesh maxilla_mi, read_jaw(files.maxilla_mi));
  GNATHION_TRY(const TriangleMesh mandible_mi, read_jaw(files.mandible_mi));
  GNATHION_TRY(const TriangleMesh maxilla_tp, read_jaw(files.maxilla_tp));
  GNATHION_TRY(const TriangleMesh mandible_tp, read_jaw(files.mandible_tp));
  SilentProgress silent;
  const auto r = therapeutic_from_scans(maxilla_mi, mandible_mi, maxilla_tp, mandible_tp, {}, silent);
  if (!r) {
    notes.push_back("intraoral scans in TP are left out of the frames: " + r.error().line());
    return {};
  }
  const ChainPose &u = r->dental_from_intraoral_tp, &l = r->mandible;
  GNATHION_CHECK_OK(
      graph.add(edge_of("dental", "intraoral_tp", u.value, u.covariance, date_of(files.maxilla_tp),
                        "upper arches of the intraoral scans", "upper arches")));
  GNATHION_CHECK_OK(
      graph.add(edge_of("intraoral_tp", "mandible_tp", l.value, l.covariance, date_of(files.mandible_tp),
                        "lower arches of the intraoral scans", "lower arches")));
  graph.set_cross_covariance("upper arches", "lower arches", r->cross_covariance);
  return {};
}

/// One [[frame]] table.
class HandEdge {
 public:
  HandEdge(const CaseFile& files, const toml::table& table) : files_(files), table_(table) {}

  Result<FrameEdge> read() {
    for (const auto& [key, node] : table_) {
      static const char* const kKnown[] = {"to",         "from", "matrix",   "transform",
                                           "scan",       "onto", "sigma_mm", "sigma_deg",
                                           "covariance", "date", "source"};
      if (std::find(std::begin(kKnown), std::end(kKnown), key.str()) == std::end(kKnown))
        return bad("unknown key '" + std::string(key.str()) + "' in [[frame]]");
    }
    edge_.to = table_["to"].value_or(std::string());
    edge_.from = table_["from"].value_or(std::string());
    if (edge_.to.empty() || edge_.from.empty()) return bad("[[frame]] needs 'to' and 'from'");
    edge_.by_hand = true;
    edge_.source = table_["source"].value_or(std::string("given in case.toml"));
    read_date();
    const int ways = static_cast<int>(table_.contains("matrix")) +
                     static_cast<int>(table_.contains("transform")) +
                     static_cast<int>(table_.contains("scan"));
    if (ways != 1) return bad(edge_.name() + ": one of 'matrix', 'transform' and 'scan' is needed");
    if (table_.contains("scan")) {
      GNATHION_CHECK_OK(register_scan());
      return edge_;
    }
    GNATHION_CHECK_OK(table_.contains("matrix") ? read_matrix() : read_transform());
    GNATHION_CHECK_OK(read_covariance());
    return edge_;
  }

 private:
  tl::unexpected<Error> bad(const std::string& why) const {
    return bad_input(kWhat, files_.toml().string(), why);
  }

  Result<std::vector<double>> numbers(const char* key, std::size_t count) const {
    std::vector<double> out;
    if (const toml::array* a = table_[key].as_array())
      for (const auto& v : *a)
        if (const auto d = v.value<double>()) out.push_back(*d);
    if (out.size() != count) return bad(fmt::format("{}: '{}' is not {} numbers", edge_.name(), key, count));
    return out;
  }

  void read_date() {
    if (const auto text = table_["date"].value<std::string>()) {
      edge_.date = *text;
    } else if (table_.contains("date")) {
      std::ostringstream out;
      table_["date"].visit([&](const auto& node) {
        if constexpr (toml::is_date<decltype(node)> || toml::is_date_time<decltype(node)>) out << node.get();
      });
      edge_.date = out.str();
    }
  }

  Status read_matrix() {
    GNATHION_TRY(const std::vector<double> v, numbers("matrix", 16));
    std::string text;
    for (const double d : v) text += fmt::format("{:.17g} ", d);
    GNATHION_TRY(const MotionFile read, parse_motion(text, files_.toml().string() + ": " + edge_.name()));
    edge_.to_from_from = read.motion.rigid;
    return {};
  }

  /// JSON of `gnathion frames --to --from` (kind "pose"), 16 numbers, or ITK's .tfm (its inverse is taken).
  Status read_transform() {
    const fs::path path = files_.folder / table_["transform"].value_or(std::string());
    GNATHION_TRY(const std::string text, read_file(path));
    if (edge_.date.empty()) edge_.date = date_of(path);
    const json j = json::parse(text, nullptr, false);
    if (j.is_object() && j.value("kind", json()) == "pose") {
      if (j.value("to", json()) != edge_.to || j.value("from", json()) != edge_.from)
        return bad_input(kWhat, path.string(), "a pose of other frames than " + edge_.name());
      GNATHION_TRY(const Matrix4 m, matrix_from_json(j.value("matrix", json()), path.string()));
      if (!rigidity_deviation(m).is_rigid()) return bad_input(kWhat, path.string(), "not a rigid motion");
      edge_.to_from_from = nearest_rigid(m);
      if (j.contains("covariance") && !j["covariance"].is_null()) {
        GNATHION_TRY(edge_.covariance, covariance_from_json(j["covariance"], path.string()));
      }
      return {};
    }
    GNATHION_TRY(const MotionFile read, parse_motion(text, path.string()));
    edge_.to_from_from = read.motion.rigid;
    edge_.covariance = read.covariance;
    return {};
  }

  Status read_covariance() {
    if (table_.contains("covariance") && (table_.contains("sigma_mm") || table_.contains("sigma_deg")))
      return bad(edge_.name() + ": give 'covariance' or 'sigma_mm' and 'sigma_deg', not both");
    if (table_.contains("covariance")) {
      GNATHION_TRY(const std::vector<double> v, numbers("covariance", 36));
      edge_.covariance = Eigen::Map<const Eigen::Matrix<double, 6, 6, Eigen::RowMajor>>(v.data());
    }
    const auto mm = table_["sigma_mm"].value<double>(), deg = table_["sigma_deg"].value<double>();
    if (mm.has_value() != deg.has_value()) return bad(edge_.name() + ": sigma_mm and sigma_deg go together");
    if (!mm) return {};
    if (!(*mm > 0.0) || !(*deg > 0.0)) return bad(edge_.name() + ": a sigma is not positive");
    Vector6 sigma;
    sigma << Vector3::Constant(*deg * M_PI / 180.0), Vector3::Constant(*mm);
    edge_.covariance = Matrix6(sigma.cwiseAbs2().asDiagonal());
    return {};
  }

  /// `scan` holds a surface in `from` that resembles the arch `onto`, which is in `to`.
  Status register_scan() {
    const std::string onto = table_["onto"].value_or(std::string());
    const fs::path target = onto == "maxilla_mi"    ? files_.maxilla_mi
                            : onto == "mandible_mi" ? files_.mandible_mi
                                                    : "";
    if (target.empty() || edge_.to != "dental")
      return bad_input(
          kWhat, files_.toml().string(),
          edge_.name() + ": a scan is registered to \"dental\", onto \"maxilla_mi\" or \"mandible_mi\"");
    const fs::path path = files_.folder / table_["scan"].value_or(std::string());
    GNATHION_TRY(const TriangleMesh scan, read_jaw(path));
    GNATHION_TRY(const TriangleMesh arch, read_jaw(target));
    AlignOptions options;
    options.name = edge_.name();
    options.gate_mm = 1.0;
    options.scale_sigma = 5e-4;
    GNATHION_TRY(const Alignment found, align_surfaces(scan, arch, options));
    edge_.to_from_from = found.target_from_source;
    edge_.covariance = found.covariance;
    if (edge_.date.empty()) edge_.date = date_of(path);
    if (!table_.contains("source")) edge_.source = path.filename().string() + " registered onto " + onto;
    return {};
  }

  const CaseFile& files_;
  const toml::table& table_;
  FrameEdge edge_;
};

/// The volume, and the face scan over its skin, where a run registered them.
Status add_cbct(const CaseFile& files, FramesGraph& graph) {
  const fs::path made = files.folder / ".steps" / "cbct";
  const std::string date = date_of(files.cbct);
  for (const auto& [from, source] : {std::pair("dental", "upper crowns in the CBCT"),
                                     std::pair("face_mi", "face scan on the skin in the CBCT")}) {
    const fs::path path = made / fmt::format("cbct_from_{}.json", from);
    std::error_code ec;
    if (!fs::exists(path, ec)) continue;
    GNATHION_TRY(const json j, read_json(path));
    GNATHION_TRY(const Matrix4 m, matrix_from_json(j.value("matrix", json()), path.string()));
    GNATHION_TRY(const Matrix6 covariance,
                 covariance_from_json(j.value("covariance", json()), path.string()));
    GNATHION_CHECK_OK(graph.add(edge_of("cbct", from, nearest_rigid(m), covariance, date, source, source)));
  }
  return {};
}

}  // namespace

Result<FramesGraph> frames_of_run(const CaseFile& files, const CaseResults& results,
                                  std::vector<std::string>& notes) {
  GNATHION_TRY(const TriangleMesh mandible, read_jaw(files.mandible_mi));
  FramesGraph graph(teeth_of(mandible));
  if (results.route == PositionRoute::kMeasured) {
    GNATHION_CHECK_OK(add_chain(files, results.chain, graph));
    GNATHION_CHECK_OK(add_camera(files, results.camera, graph));
  }
  if (!files.cbct.empty()) GNATHION_CHECK_OK(add_cbct(files, graph));
  GNATHION_CHECK_OK(add_intraoral_tp(files, graph, notes));
  GNATHION_CHECK_OK(add_frames_by_hand(files, graph));
  return graph;
}

Status add_frames_by_hand(const CaseFile& files, FramesGraph& graph) {
  GNATHION_TRY(const toml::table t, read_toml(files.toml(), kWhat));
  if (!t.contains("frame")) return {};
  const toml::array* frames = t["frame"].as_array();
  if (frames == nullptr) return bad_input(kWhat, files.toml().string(), "'frame' is not [[frame]]");
  for (const auto& node : *frames) {
    if (!node.is_table()) return bad_input(kWhat, files.toml().string(), "'frame' is not [[frame]]");
    GNATHION_TRY(FrameEdge edge, HandEdge(files, *node.as_table()).read());
    GNATHION_CHECK_OK(graph.add(std::move(edge)));
  }
  return {};
}

Result<FramesGraph> read_case_frames(const fs::path& folder) {
  GNATHION_TRY(const CaseFile files, read_case(folder));
  const fs::path measured = folder / "results" / "frames.json";
  std::error_code ec;
  FramesGraph graph;
  if (fs::exists(measured, ec)) {
    GNATHION_TRY(const json j, read_json(measured));
    GNATHION_TRY(const FramesGraph read, frames_from_json(j, measured.string()));
    graph = FramesGraph(read.teeth_mm());
    for (const FrameEdge& e : read.edges())
      if (!e.by_hand) GNATHION_CHECK_OK(graph.add(e));
    for (const auto& [pair, block] : read.cross_covariances())
      graph.set_cross_covariance(pair.first, pair.second, block);
  } else {
    GNATHION_TRY(const TriangleMesh mandible, read_jaw(files.mandible_mi));
    graph = FramesGraph(teeth_of(mandible));
  }
  GNATHION_CHECK_OK(add_frames_by_hand(files, graph));
  if (graph.edges().empty())
    return bad_input("cannot show frames", folder.string(),
                     "the case has not been run, and case.toml has no [[frame]]");
  return graph;
}

}  // namespace gnathion
