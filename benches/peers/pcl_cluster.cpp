// Euclidean clustering by PCL, for comparison: pcl_cluster POINTS LABELS TOLERANCE MIN MAX RUNS
//
// POINTS holds float32 x y z a point; LABELS gets one int32 a point, its cluster's number or -1. Clusters are numbered
// by their smallest point index, as ours are. Prints the best time of RUNS, k-d tree included, in milliseconds, and
// the number of clusters.

#include <pcl/point_cloud.h>
#include <pcl/point_types.h>
#include <pcl/search/kdtree.h>
#include <pcl/segmentation/extract_clusters.h>

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <vector>

int main(int argc, char** argv) {
    if (argc != 7) {
        std::fprintf(stderr, "usage: pcl_cluster POINTS LABELS TOLERANCE MIN MAX RUNS\n");
        return 2;
    }
    std::ifstream in(argv[1], std::ios::binary);
    std::vector<char> bytes((std::istreambuf_iterator<char>(in)), {});
    const float* values = reinterpret_cast<const float*>(bytes.data());
    auto cloud = pcl::make_shared<pcl::PointCloud<pcl::PointXYZ>>();
    for (std::size_t i = 0; i + 12 <= bytes.size(); i += 12, values += 3) {
        cloud->push_back(pcl::PointXYZ(values[0], values[1], values[2]));
    }

    std::vector<pcl::PointIndices> clusters;
    double best = 1e9;
    for (int run = 0; run < std::atoi(argv[6]); ++run) {
        clusters.clear();
        const auto start = std::chrono::steady_clock::now();
        auto tree = pcl::make_shared<pcl::search::KdTree<pcl::PointXYZ>>();
        tree->setInputCloud(cloud);
        pcl::EuclideanClusterExtraction<pcl::PointXYZ> extraction;
        extraction.setClusterTolerance(std::atof(argv[3]));
        extraction.setMinClusterSize(std::atoi(argv[4]));
        extraction.setMaxClusterSize(std::atoi(argv[5]));
        extraction.setSearchMethod(tree);
        extraction.setInputCloud(cloud);
        extraction.extract(clusters);
        const std::chrono::duration<double, std::milli> elapsed = std::chrono::steady_clock::now() - start;
        best = std::min(best, elapsed.count());
    }

    const auto smallest = [](const pcl::PointIndices& c) {
        return *std::min_element(c.indices.begin(), c.indices.end());
    };
    std::sort(clusters.begin(), clusters.end(), [&](const auto& a, const auto& b) { return smallest(a) < smallest(b); });
    std::vector<std::int32_t> labels(cloud->size(), -1);
    for (std::size_t c = 0; c < clusters.size(); ++c) {
        for (const int i : clusters[c].indices) labels[i] = static_cast<std::int32_t>(c);
    }
    std::ofstream out(argv[2], std::ios::binary);
    out.write(reinterpret_cast<const char*>(labels.data()), labels.size() * sizeof(labels[0]));
    std::printf("%.2f %zu\n", best, clusters.size());
    return 0;
}
