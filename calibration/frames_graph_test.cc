#include "calibration/frames_graph.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>

#include "calibration/frames_graph_json.h"
#include "core/random.h"

namespace gnathion {
namespace {

Rigid3 any_pose(Random& random) {
  return {random.rotation(), 80.0 * random.normal3()};
}
Matrix6 some_covariance(Random& random, double size) {
  Matrix6 a;
  for (int r = 0; r < 6; ++r)
    for (int c = 0; c < 6; ++c) a(r, c) = (r < 3 ? 0.01 : 1.0) * random.normal();
  return size * size * (a * a.transpose()) / 6.0;
}
Vector6 draw(const Matrix6& covariance, Random& random) {
  Vector6 z;
  for (int k = 0; k < 6; ++k) z[k] = random.normal();
  return covariance.llt().matrixL() * z;
}
const std::vector<Vector3> kTeeth = {{0, 0, 0}, {25, 35, 0}, {-25, 35, 0}};

/// Frames at true poses; edges are true but for errors drawn from their covariance.
struct World {
  Random random;
  std::map<std::string, Rigid3> dental_from;
  FramesGraph graph{kTeeth};

  explicit World(std::uint64_t seed) : random(seed) {
    for (const char* f : {"bow", "face_mi", "face_tp", "head_frame", "bow_tp", "cbct"})
      dental_from[f] = any_pose(random);
    dental_from["dental"] = Rigid3::identity();
  }
  Rigid3 truth(const std::string& to, const std::string& from) const {
    return dental_from.at(to).inverse() * dental_from.at(from);
  }
  void link(const std::string& to, const std::string& from, double size,
            const Vector6& blunder = Vector6::Zero()) {
    FrameEdge e;
    e.to = to;
    e.from = from;
    e.covariance = some_covariance(random, size);
    e.to_from_from = exp_se3(blunder) * exp_se3(draw(*e.covariance, random)) * truth(to, from);
    ASSERT_TRUE(graph.add(e));
  }
};

TEST(FramesGraph, ComposesAlongTheBestWay) {
  World w(11);
  w.link("bow", "dental", 0.02);
  w.link("bow", "face_mi", 0.02);
  w.link("dental", "face_mi", 3.0);  // direct, and bad
  const auto path = w.graph.path("dental", "face_mi");
  ASSERT_TRUE(path) << path.error().line();
  ASSERT_EQ(path->steps.size(), 2u);
  EXPECT_TRUE(path->steps[0].inverse);
  EXPECT_FALSE(path->steps[1].inverse);
  const Rigid3 expected = w.graph.edges()[0].to_from_from.inverse() * w.graph.edges()[1].to_from_from;
  EXPECT_LT((path->to_from_from.matrix() - expected.matrix()).norm(), 1e-12);
  EXPECT_LT(*path->at_teeth_mm, 1.0);
  const auto back = w.graph.path("face_mi", "dental");
  ASSERT_TRUE(back);
  EXPECT_LT((back->to_from_from.matrix() * path->to_from_from.matrix() - Matrix4::Identity()).norm(), 1e-10);
  EXPECT_NEAR(*back->at_teeth_mm, *path->at_teeth_mm, 1e-6 * *path->at_teeth_mm)
      << "an error at the teeth is the same seen from either end";
}

// The stated covariance against errors that were drawn: an estimate that the way uses twice (T_D, forth and
// back) and a cross term among them.
TEST(FramesGraph, CovarianceIsThatOfDrawnErrors) {
  Random random(5);
  const Rigid3 t_d = any_pose(random), motion = Rigid3::about_axis({0, -90, -30}, {1, 0.1, 0}, 0.06);
  const Rigid3 k0 = any_pose(random), k1 = k0 * t_d * motion * t_d.inverse();
  Eigen::Matrix<double, 18, 18> joint = Eigen::Matrix<double, 18, 18>::Zero();
  Eigen::Matrix<double, 18, 18> root;
  for (int r = 0; r < 18; ++r)
    for (int c = 0; c < 18; ++c) root(r, c) = (r % 6 < 3 ? 2e-4 : 0.02) * random.normal();
  joint = root * root.transpose() / 18.0;
  const auto block = [&](int a, int b) { return Matrix6(joint.block<6, 6>(6 * a, 6 * b)); };
  const auto graph_with = [&](const Eigen::Matrix<double, 18, 1>& xi) {
    FramesGraph g(kTeeth);
    const auto add = [&](const char* to, const char* from, const Rigid3& x, int k, const char* estimate) {
      FrameEdge e;
      e.to = to;
      e.from = from;
      e.to_from_from = exp_se3(xi.segment<6>(6 * k)) * x;
      e.covariance = block(k, k);
      e.estimate = estimate;
      EXPECT_TRUE(g.add(e));
    };
    add("bow", "dental", t_d, 0, "T_D");
    add("head_frame", "bow", k0, 1, "K0");
    add("head_frame", "bow_tp", k1, 2, "K1");
    add("bow_tp", "mandible_tp", t_d, 0, "T_D");
    g.set_cross_covariance("T_D", "K0", block(0, 1));
    g.set_cross_covariance("T_D", "K1", block(0, 2));
    g.set_cross_covariance("K0", "K1", block(1, 2));
    return g;
  };
  const auto stated = graph_with(Eigen::Matrix<double, 18, 1>::Zero()).path("dental", "mandible_tp");
  ASSERT_TRUE(stated) << stated.error().line();
  EXPECT_LT((stated->to_from_from.matrix() - motion.matrix()).norm(), 1e-9);
  Matrix6 drawn = Matrix6::Zero();
  constexpr int kRuns = 4000;
  for (int run = 0; run < kRuns; ++run) {
    Eigen::Matrix<double, 18, 1> z;
    for (int k = 0; k < 18; ++k) z[k] = random.normal();
    const Eigen::Matrix<double, 18, 1> xi = root * z / std::sqrt(18.0);
    const auto found = graph_with(xi).path("dental", "mandible_tp");
    const Vector6 error = difference(found->to_from_from, motion);
    drawn += error * error.transpose() / kRuns;
  }
  // In the stated covariance's own units; 4000 draws tell variances to about 2 %.
  const Matrix6 whiten = stated->covariance->llt().matrixL().solve(Matrix6::Identity());
  EXPECT_LT((whiten * drawn * whiten.transpose() - Matrix6::Identity()).cwiseAbs().maxCoeff(), 0.12);
}

TEST(FramesGraph, LoopsThatCloseAreConsistent) {
  int open = 0, loops = 0;
  for (std::uint64_t seed = 100; seed < 140; ++seed) {
    World w(seed);
    w.link("bow", "dental", 0.03);
    w.link("bow", "face_mi", 0.03);
    w.link("head_frame", "bow", 0.03);
    w.link("head_frame", "face_mi", 0.03);
    w.link("cbct", "dental", 0.1);
    w.link("cbct", "head_frame", 0.1);
    for (const FrameLoop& loop : w.graph.loops()) {
      ++loops;
      open += loop.consistent() ? 0 : 1;
    }
  }
  EXPECT_GE(loops, 80);
  EXPECT_LE(open, 4) << "p < 0.003 in about 100 loops";
}

TEST(FramesGraph, TheEdgeThatContradictsIsNamed) {
  World w(7);
  w.link("bow", "dental", 0.03);
  w.link("bow", "face_mi", 0.03);
  w.link("head_frame", "bow", 0.03);
  w.link("head_frame", "face_mi", 0.03);
  w.link("cbct", "dental", 0.03);
  w.link("cbct", "head_frame", 0.03, (Vector6() << 0, 0, 0.02, 1.0, 0, 0).finished());  // slipped by 1 mm
  w.link("cbct", "bow", 0.03);
  const auto loops = w.graph.loops();
  const auto suspects = w.graph.suspects(loops);
  ASSERT_EQ(suspects.size(), 1u);
  EXPECT_EQ(w.graph.edges()[suspects[0].edge].name(), "cbct <- head_frame");
  EXPECT_TRUE(suspects[0].certain);
  const std::string text = frames_text(w.graph);
  EXPECT_NE(text.find("inconsistent cbct <- head_frame"), std::string::npos) << text;
}

TEST(FramesGraph, EdgesThatClaimToBeExactAreContradictedByAnyOpening) {
  FramesGraph graph;
  FrameEdge edge;
  edge.to = "a";
  edge.from = "b";
  edge.covariance = Matrix6::Zero();
  ASSERT_TRUE(graph.add(edge));
  edge.to_from_from = Rigid3::from_translation({5, 0, 0});
  ASSERT_TRUE(graph.add(edge));
  const auto loops = graph.loops();
  ASSERT_EQ(loops.size(), 1u);
  EXPECT_LT(loops.front().p_value, 1e-6);
}

TEST(FramesGraph, UnknownCovarianceIsSaidAndAvoided) {
  World w(3);
  w.link("bow", "dental", 0.02);
  w.link("bow", "cbct", 0.5);
  FrameEdge e;
  e.to = "dental";
  e.from = "cbct";
  e.to_from_from = w.truth("dental", "cbct");
  ASSERT_TRUE(w.graph.add(e));
  const auto path = w.graph.path("dental", "cbct");
  ASSERT_TRUE(path);
  EXPECT_EQ(path->steps.size(), 2u) << "the way with a known error goes before the short one";
  ASSERT_EQ(w.graph.loops().size(), 1u);
  EXPECT_FALSE(w.graph.loops()[0].p_value);
  FrameEdge plaster = e;
  plaster.from = "plaster";
  ASSERT_TRUE(w.graph.add(plaster));
  const auto unknown = w.graph.path("dental", "plaster");
  ASSERT_TRUE(unknown);
  EXPECT_FALSE(unknown->covariance);
  EXPECT_NE(path_text(w.graph, *unknown).find("error unknown"), std::string::npos);
}

TEST(FramesGraph, RefusesWhatIsNoWay) {
  World w(3);
  w.link("bow", "dental", 0.02);
  w.link("cbct", "head_frame", 0.02);
  const auto none = w.graph.path("dental", "cbct");
  ASSERT_FALSE(none);
  EXPECT_EQ(none.error().code, ErrorCode::kInput);
  const auto typo = w.graph.path("dental", "cbtc");
  ASSERT_FALSE(typo);
  EXPECT_NE(typo.error().line().find("cbct"), std::string::npos) << "the known names are listed";
  FrameEdge self;
  self.to = self.from = "bow";
  EXPECT_FALSE(w.graph.add(self));
}

TEST(FramesGraph, FileGivesBackTheGraph) {
  World w(9);
  w.link("bow", "dental", 0.03);
  w.link("bow", "face_mi", 0.03);
  w.link("face_mi", "dental", 0.03);
  w.graph.set_cross_covariance(w.graph.edges()[0].estimate, w.graph.edges()[1].estimate,
                               1e-6 * Matrix6::Identity());
  const nlohmann::json j = frames_json(w.graph);
  const auto back = frames_from_json(nlohmann::json::parse(j.dump()), "frames.json");
  ASSERT_TRUE(back) << back.error().line();
  ASSERT_EQ(back->edges().size(), 3u);
  const auto before = w.graph.path("dental", "face_mi"), after = back->path("dental", "face_mi");
  ASSERT_TRUE(before && after);
  EXPECT_LT((before->to_from_from.matrix() - after->to_from_from.matrix()).norm(), 1e-9);
  EXPECT_LT((*before->covariance - *after->covariance).norm(), 1e-9 * before->covariance->norm());
  EXPECT_EQ(back->cross_covariances().size(), 2u);
  nlohmann::json broken = j;
  broken["edges"][0]["matrix"][0][0] = 3.0;
  EXPECT_FALSE(frames_from_json(broken, "frames.json"));
  EXPECT_FALSE(frames_from_json(nlohmann::json::object(), "frames.json"));
}

}  // namespace
}  // namespace gnathion
