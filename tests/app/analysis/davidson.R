# Davidson's model as a log-linear model by base R: counts of win, loss and tie of each pair, given on standard input.
# Source: Critchlow and Fligner (1991), "Paired comparison, triple comparison, and ranking experiments as generalized
# linear models".
counts <- read.csv(file("stdin"))
items <- sort(unique(c(counts$item_a, counts$item_b)))
pairs <- nrow(counts)
y <- c(counts$wins, counts$losses, counts$ties)
half <- sapply(items, function(item) ((counts$item_a == item) - (counts$item_b == item)) / 2)
X <- cbind(rbind(diag(pairs), diag(pairs), diag(pairs)),
           tie = rep(c(0, 0, 1), each = pairs),
           rbind(half, -half, 0 * half)[, -1])
fit <- glm(y ~ 0 + X, family = poisson, control = glm.control(epsilon = 1e-14, maxit = 100))
n <- length(items)
from_first <- rbind(0, diag(n - 1))
centred <- from_first - matrix(1 / n, n, n) %*% from_first
scores <- (pairs + 2):length(coef(fit))
covariance <- centred %*% vcov(fit)[scores, scores] %*% t(centred)
result <- data.frame(name = c(items, "log_nu"),
                     estimate = c(centred %*% coef(fit)[scores], coef(fit)[pairs + 1]),
                     se = sqrt(c(diag(covariance), vcov(fit)[pairs + 1, pairs + 1])))
options(digits = 15)
write.csv(result, stdout(), row.names = FALSE)
